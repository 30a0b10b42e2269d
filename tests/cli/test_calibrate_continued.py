"""``ospc calibrate``, resumed from a checkpoint after a kill, or started from an earlier calibration."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from functools import partial

import pytest

from command_line import leave_out, ospc
from ospc.calibrator import OnlineCalibrator
from ospc.cli.calibration_run import Checkpoints
from ospc.errors import SettingError
from ospc.photometry.calibration import Calibration
from ospc.pooling.pool import Pool
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.report.output_folder import OutputFolder
from ospc.simulation import SimulationSettings, simulate

EXPOSURES = (3.0, 6.0, 12.0, 24.0)
QUICK = ("--set", "points_per_pair=60", "--set", "max_points=1500", "--set", "rounds=3", "--set", "keyframes=6")
PROGRAM = """
import time
from ospc.cli.calibration_run import Checkpoints
from ospc.cli.main import main
save = Checkpoints.after_frame
def save_and_wait(checkpoints, calibrator):
    save(checkpoints, calibrator)
    if calibrator.frames == 20:
        print("saved", flush=True)
        time.sleep(60)
Checkpoints.after_frame = save_and_wait
main()
"""


def simulated(place, frames=32, **settings):
    simulate(
        place,
        SimulationSettings(size=(160, 120), frames=frames, exposure="cycle", exposures_ms=EXPOSURES, **settings),
    )
    return place


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("recordings") / "first")


run = partial(ospc, "calibrate")


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize(("every_s", "expected"), [(0.01, 3), (None, 1)])
def test_a_stated_interval_between_checkpoints_is_kept_even_if_saving_is_slow(
    tmp_path, monkeypatch, every_s, expected
):
    saved = []

    def save(*_, **__):
        time.sleep(0.02)
        saved.append(None)

    monkeypatch.setattr(Checkpoints, "save", save)
    checkpoints = Checkpoints(OutputFolder(tmp_path), every_s)
    for _ in range(3):
        checkpoints.after_frame(None)
        time.sleep(0.02)
    assert len(saved) == expected


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


def test_a_killed_and_resumed_run_gives_the_same_bytes(recording, uninterrupted, tmp_path):
    out = tmp_path / "out"
    arguments = [str(recording), "-o", str(out), *QUICK, "--resume"]
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "calibrate", *arguments, "--checkpoint-every", "0"],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "saved\n"
        process.kill()
    assert OnlineCalibrator.load_state(out / "state.ospc").frames == 20
    result = run(*arguments)
    assert result.exit_code in (0, 3), result.output
    for name in ("calibration.json", "state.ospc", "pcalib.txt"):
        assert (out / name).read_bytes() == (uninterrupted / name).read_bytes()
    assert not list(out.glob(".*"))


@pytest.mark.skipif(
    threading.current_thread() is not threading.main_thread(), reason="signals reach only the main thread"
)
def test_an_interrupted_repetition_keeps_the_complete_result_and_can_be_resumed(
    recording, uninterrupted, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    shutil.copytree(uninterrupted, out)

    def interrupted(_checkpoints, calibrator):
        if calibrator.frames == 20:
            os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoints, "after_frame", interrupted)
        assert run(recording, "-o", out, *QUICK).exit_code == 130
    assert contents(out) == contents(uninterrupted)
    assert Calibration.load(out / "partial").counts["frames"] == 20
    assert OnlineCalibrator.load_state(out / "partial" / "state.ospc").frames == 20

    result = run(recording, "-o", out, *QUICK, "--resume")
    assert "continuing after frame 20" in result.stderr + result.stdout
    assert contents(out) == contents(uninterrupted)
    assert not (out / "partial").exists()


def test_checkpoints_of_a_repetition_do_not_replace_the_state_of_a_complete_result(uninterrupted, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(uninterrupted, out)
    Checkpoints(OutputFolder(out)).save(OnlineCalibrator("default"))
    assert contents(out) == contents(uninterrupted)
    assert (out / "partial" / "state.ospc").is_file()


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
    assert "belongs to another recording (first)" in str(result.exception)


def test_a_run_starts_from_an_earlier_one(recording, uninterrupted, tmp_path):
    shorter = simulated(tmp_path / "today", frames=16, seed=5, scene_seed=0)
    result = run(shorter, "-o", tmp_path / "out", *QUICK, "--start-from", uninterrupted)
    assert result.exit_code in (0, 3), result.output
    found = Calibration.load(tmp_path / "out")
    assert found.source["started_from"] == {"name": str(uninterrupted), "changed": [], "text": ""}
    assert found.source["name"] == "today"
    assert "starting from" in found.verdicts["response"].reason


def test_the_method_of_the_paper_cannot_start_from_an_earlier_calibration(uninterrupted, tmp_path):
    other = simulated(tmp_path / "today", frames=4)
    result = run(other, "-o", tmp_path / "out", "--preset", "paper", "--start-from", uninterrupted)
    assert "preset paper cannot start from an earlier calibration" in str(result.exception)
    with pytest.raises(SettingError, match="preset paper cannot start"):
        OnlineCalibrator("paper", prior=PriorCalibration.open(uninterrupted))


def test_a_changed_lens_is_reported(uninterrupted, tmp_path):
    other = simulated(tmp_path / "today", frames=24, seed=5, scene_seed=0, vignette_coefficients=(-1.0, 0.4, -0.1))
    result = run(other, "-o", tmp_path / "out", *QUICK, "--start-from", uninterrupted, "--json")
    notes = json.loads(result.stdout)["notes"]
    assert any("has changed since" in note and "lens" in note for note in notes)
    assert Calibration.load(tmp_path / "out").source["started_from"]["changed"] == ["vignette"]
