"""``ospc calibrate`` that goes on: from a checkpoint after a kill, and from an earlier calibration."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial

import pytest

from command_line import leave_out, ospc
from ospc.errors import SettingError
from ospc.photometry.calibration import Calibration
from ospc.pooling.pool import Pool
from ospc.simulation import SimulationSettings, simulate

EXPOSURES = (3.0, 6.0, 12.0, 24.0)
QUICK = ("--set", "points_per_pair=60", "--set", "max_points=1500", "--set", "rounds=3", "--set", "keyframes=6")
PROGRAM = """
from ospc.cli.main import main
from ospc.output import OutputFolder, Written
OutputFolder.draw = OutputFolder.report = lambda *_, **__: Written()
main()
"""
KILLS_S = (0.0, 0.3)
"""How long runs live after they wrote their first checkpoint."""


def simulated(place, frames=48, **settings):
    simulate(
        place,
        SimulationSettings(size=(160, 120), frames=frames, exposure="cycle", exposures_ms=EXPOSURES, **settings),
    )
    return place


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("recordings") / "first")


run = partial(ospc, "calibrate")


@pytest.fixture(autouse=True)
def nothing_drawn(monkeypatch):
    leave_out(monkeypatch, "draw", "report")


@pytest.fixture(scope="module")
def uninterrupted(recording, tmp_path_factory):
    out = tmp_path_factory.mktemp("uninterrupted") / "out"
    with pytest.MonkeyPatch.context() as patch:
        leave_out(patch, "draw", "report")
        run(recording, "-o", out, *QUICK)
    return out


def test_killed_again_and_again_it_ends_with_the_same_bytes(recording, uninterrupted, tmp_path):
    out = tmp_path / "out"
    arguments = [str(recording), "-o", str(out), *QUICK, "--resume", "--checkpoint-every", "0"]
    for after_s in KILLS_S:
        before = (out / "state.ospc").stat().st_mtime_ns if (out / "state.ospc").exists() else 0
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, "calibrate", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        while process.poll() is None:
            if (out / "state.ospc").exists() and (out / "state.ospc").stat().st_mtime_ns > before:
                time.sleep(after_s)
                os.kill(process.pid, signal.SIGKILL)
                break
            time.sleep(0.005)
        process.communicate()
    result = run(*arguments)
    assert result.exit_code in (0, 3), result.output
    for name in ("calibration.json", "state.ospc", "pcalib.txt"):
        assert (out / name).read_bytes() == (uninterrupted / name).read_bytes()
    assert not list(out.glob(".*"))


def test_a_state_can_be_merged(uninterrupted):
    assert len(Pool.load(uninterrupted)) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [(["--set", "rounds=4"], "other settings .rounds 3 instead of 4"), (["--preset", "paper"], "no checkpoints")],
)
def test_resuming_with_other_settings_is_refused(recording, uninterrupted, change, said):
    before = (uninterrupted / "calibration.json").read_bytes()
    quick = [] if "paper" in change else QUICK
    result = run(recording, "-o", uninterrupted, *quick, *change, "--resume")
    assert isinstance(result.exception, SettingError)
    assert re.search(said, str(result.exception))
    assert (uninterrupted / "calibration.json").read_bytes() == before


def test_resuming_another_recording_is_refused(uninterrupted, tmp_path):
    other = simulated(tmp_path / "other", frames=5, seed=3, scene_seed=0)
    result = run(other, "-o", uninterrupted, *QUICK, "--resume")
    assert isinstance(result.exception, SettingError)
    assert "state of another recording (first)" in str(result.exception)


def test_a_run_starts_from_an_earlier_one(recording, uninterrupted, tmp_path):
    shorter = simulated(tmp_path / "today", frames=16, seed=5, scene_seed=0)
    result = run(shorter, "-o", tmp_path / "out", *QUICK, "--start-from", uninterrupted)
    assert result.exit_code in (0, 3), result.output
    found = Calibration.load(tmp_path / "out")
    assert found.source["started_from"] == {"name": str(uninterrupted), "changed": [], "text": ""}
    assert found.source["name"] == "today"
    assert "starting from" in found.verdicts["response"].reason


def test_a_changed_lens_is_said(uninterrupted, tmp_path):
    other = simulated(tmp_path / "today", seed=5, scene_seed=0, vignette_coefficients=(-1.0, 0.4, -0.1))
    result = run(other, "-o", tmp_path / "out", *QUICK, "--start-from", uninterrupted, "--json")
    notes = json.loads(result.stdout)["notes"]
    assert any("is not the camera of" in note and "lens" in note for note in notes)
    assert Calibration.load(tmp_path / "out").source["started_from"]["changed"] == ["vignette"]
