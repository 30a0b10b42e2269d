"""``ospc report``, and the report written by ``ospc calibrate``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrations import SIZE, calibration
from command_line import leave_out, ospc
from ospc.errors import FormatError, OspcError
from ospc.recording import identity, open_recording
from ospc.recording.derived import Region, masked
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    place = tmp_path_factory.mktemp("simulated") / "r"
    simulate(place, SimulationSettings(size=SIZE, frames=6))
    return place


@pytest.fixture
def folder(tmp_path):
    calibration().save(tmp_path / "calibration.json")
    return tmp_path


def test_calibrate_writes_a_report_even_if_nothing_was_determined(recording, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw")
    done = ospc("calibrate", recording, "-o", tmp_path / "out")
    assert done.exit_code == 3
    assert "report.html" in done.output
    content = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "This recording does not determine the response and the vignette" in content


def test_the_report_can_be_written_again(folder):
    done = ospc("report", folder)
    assert done.exit_code == 0
    assert done.stdout.splitlines() == [str(folder / "report.html")]
    assert "Before and after" not in (folder / "report.html").read_text(encoding="utf-8")


def test_what_is_missing_without_the_recording_is_said(folder, recording):
    missing = "the report has no pictures and no effect on tracking"
    assert missing in ospc("report", folder).stderr
    assert missing not in ospc("report", folder, "--recording", recording).output
    replace(calibration(), source={"name": "mine"}).save(folder / "calibration.json")
    assert "--recording, here mine" in ospc("report", folder).stderr


def test_pictures_come_from_the_given_recording(folder, recording):
    assert ospc("report", folder, "--recording", recording, "--truth", recording).exit_code == 0
    content = (folder / "report.html").read_text(encoding="utf-8")
    assert "Before and after" in content
    assert "data:image/jpeg" in content
    assert "The reference is" in content


def test_another_recording_is_named_and_another_size_refused(folder, recording, tmp_path):
    source = identity(open_recording(recording)) | {"name": "mine"}
    replace(calibration(), source=source).save(folder / "calibration.json")
    assert "warning" not in ospc("report", folder, "--recording", recording).output
    simulate(tmp_path / "other", SimulationSettings(size=SIZE, frames=6, seed=2, scene_seed=0))
    said = "ictures and points are from other, but the calibration was made from mine"
    result = ospc("report", folder, "--recording", tmp_path / "other")
    assert result.exit_code == 0
    assert f"warning: p{said}" in result.output
    assert f"P{said}" in (folder / "report.html").read_text(encoding="utf-8")
    simulate(tmp_path / "small", SimulationSettings(size=(80, 60), frames=3))
    assert "has images of 80x60 pixels" in str(ospc("report", folder, "--recording", tmp_path / "small").exception)


def test_other_pixels_of_the_same_recording_are_not_called_another_recording(folder, recording):
    shown = masked(open_recording(recording), region=Region(0, 0, 40, 30))
    replace(calibration(), source=identity(shown)).save(folder / "calibration.json")
    said = ospc("report", folder, "--recording", recording).output
    assert "made from other pixels" in said
    assert "--roi" in said
    assert "warning" not in ospc("report", folder, "--recording", recording, "--roi", "0,0,40,30").output


def test_options_for_reading_need_a_recording(folder):
    assert ospc("report", folder, "--channel", "green").exit_code == 2


def test_exposures_come_from_times_txt_in_the_folder(folder):
    lines = [f"{n} {n} {e}" for n, e in enumerate(np.geomspace(1, 3, 41))]
    (folder / "times.txt").write_text("\n".join(lines))
    ospc("report", folder)
    assert "Exposures over time" in (folder / "report.html").read_text(encoding="utf-8")


def test_the_error_names_a_folder_without_calibration(tmp_path, recording):
    with pytest.raises(OspcError, match="not a folder"):
        raise ospc("report", tmp_path / "absent").exception
    with pytest.raises(FormatError, match=r"calibration\.json"):
        raise ospc("report", recording).exception
    assert not (recording / "report.html").exists()
