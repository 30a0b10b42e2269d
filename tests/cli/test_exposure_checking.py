"""``ospc calibrate`` with recordings whose exposures lag behind their frames."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import Result

sys.path.insert(0, str(Path(__file__).parents[1] / "diagnosis"))
from filmed import Film, wandering

from command_line import leave_out, ospc
from ospc.formats.dso import write_times
from ospc.photometry.calibration import Calibration
from ospc.recording import open_recording
from ospc.recording.exposure_lists import read_times
from ospc.recording.writing.conversion import convert_recording

FRAMES = 60
GREY = np.arange(30, 230) / 255


def calibrated(recording: Path, out: Path, *options: str) -> tuple[Result, dict, Calibration]:
    result = ospc("calibrate", recording, "-o", out, "--json", *options)
    return result, json.loads(result.stdout), Calibration.load(out / "calibration.json")


def shape_error(calibration: Calibration) -> float:
    """Return the RMSE of the inverse response against the film's, after the best scaling."""
    assert calibration.response is not None
    estimate, truth = calibration.response.inverse(GREY), GREY**2.2
    scale = estimate @ truth / (estimate @ estimate)
    return float(np.sqrt(np.mean((scale * estimate - truth) ** 2)))


@pytest.fixture(autouse=True)
def nothing_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    leave_out(monkeypatch, "draw", "report")


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("late") / "recording"
    convert_recording(Film(wandering(FRAMES, step=0.12), lag=2).recording(), place)
    return place


@pytest.fixture(scope="module")
def corrected(late: Path) -> tuple[Result, dict, Calibration]:
    """A calibration of the late recording, in a folder next to it."""
    with pytest.MonkeyPatch.context() as patch:
        leave_out(patch, "draw", "report")
        return calibrated(late, late.with_name("corrected"))


def test_a_lag_gives_a_corrected_calibration_and_a_note(late: Path, corrected, tmp_path: Path) -> None:
    result, said, calibration = corrected
    assert result.exit_code in (0, 3), result.output
    assert (said["exposure_lag_frames"], said["exposure_lag_corrected_frames"], said["warnings"]) == (2, 2, [])
    assert any("2 frames late" in note for note in said["notes"])
    assert calibration.source["exposure_lag_corrected_frames"] == 2
    assert shape_error(calibration) < 0.01
    shutil.copytree(late.with_name("corrected"), tmp_path / "out")
    again = ospc("calibrate", str(late), "-o", str(tmp_path / "out"), "--json", "--resume")
    assert f"continuing after frame {FRAMES}" in again.stdout


def test_every_output_has_the_exposures_at_their_frames(late: Path, corrected, tmp_path: Path) -> None:
    (_, said, _), out_of_late = corrected, late.with_name("corrected")
    recorded = read_times(late / "times.txt").exposures_ms
    at_frames = np.append(recorded[2:], [recorded[-1]] * 2)
    np.testing.assert_allclose(read_times(out_of_late / "times.txt").exposures_ms, at_frames, rtol=1e-5)
    assert any("times.txt has the exposures that the calibration used" in note for note in said["notes"])

    mended = tmp_path / "mended"
    shutil.copytree(late, mended)
    write_times(mended / "times.txt", range(FRAMES), open_recording(late).stamps_s, at_frames)
    normalised = ("--normalise-exposure", "--assume-missing", "--output", "grey16", "--reference-ms", "1")
    images = {}
    for recording in (late, mended):
        out = tmp_path / f"corrected {recording.name}"
        done = ospc("correct", recording, out_of_late, "-o", out, *normalised)
        assert done.exit_code == 0, done.output
        images[recording] = [cv2.imread(str(place), -1) for place in sorted((out / "images").iterdir())]
        note = "moved to their frames" if recording == late else "are used as recorded"
        assert note in done.output
    np.testing.assert_array_equal(images[late], images[mended])


def test_an_uncorrected_lag_gives_a_warning(late: Path, tmp_path: Path) -> None:
    result, said, calibration = calibrated(late, tmp_path, "--correct-lag", "never")
    assert result.exit_code == 3
    assert (said["exposure_lag_frames"], said["exposure_lag_corrected_frames"]) == (2, 0)
    assert "2 frames late" in said["warnings"][0]
    assert all(verdict.state != "identifiable" for verdict in calibration.verdicts.values()), calibration.verdicts
    response = calibration.verdicts["response"]
    assert response.state == "not identifiable" or "2 frames late" in response.reason
    assert not calibration.converged
    assert "WARNING: exposures are recorded 2 frames late" in result.stderr
    assert any("correct_lag" in advice for advice in said["advice"])
    assert "correct_lag" in calibration.verdicts["exposures"].remedy


@pytest.mark.parametrize(("choice", "code"), [("sometimes", 2), ("1.5", 2), ("100000", 2), ("500", 1)])
def test_invalid_lag_choices(choice: str, code: int, late: Path, tmp_path: Path) -> None:
    result = ospc("calibrate", str(late), "-o", str(tmp_path / "out"), "--correct-lag", choice)
    assert result.exit_code == code
    assert not (tmp_path / "out").exists()
