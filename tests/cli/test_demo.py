from __future__ import annotations

from dataclasses import replace
from functools import partial

from command_line import leave_out, ospc
from ospc.cli import demo
from ospc.photometry.calibration import Calibration

run = partial(ospc, "demo")


def test_the_demo_creates_a_recording_and_its_calibration_and_can_be_repeated(tmp_path, monkeypatch):
    whole = demo._settings
    monkeypatch.setattr(demo, "_settings", lambda *how: replace(whole(*how), size=(320, 240)))
    leave_out(monkeypatch, "report")
    for again in (False, True):
        if again:
            leave_out(monkeypatch, "draw")
        result = run("-o", tmp_path / "demo", "--frames", 8)
        assert result.exit_code in (0, 3), result.output
        for expected in ("simulating 8 frames", "against", "ospc calibrate"):
            assert expected in result.output
        assert ("figure.png" in result.output) is not again
    assert Calibration.load(tmp_path / "demo" / "calibration").counts["frames"] == 8
    assert (tmp_path / "demo" / "recording" / "times.txt").exists()


def test_other_files_are_kept(tmp_path):
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration" / "thesis.txt").write_text("mine")
    result = run("-o", tmp_path, "--frames", 8)
    assert "not from an earlier calibration" in str(result.exception)
    assert not (tmp_path / "recording").exists()


def test_wrong_usage(tmp_path):
    assert run("-o", tmp_path, "--frames", "0").exit_code == 2
