"""A frame with unknown exposure is skipped and counted, with the same note for every kind of input."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from calibrations import calibration
from ospc.calibrator import OnlineCalibrator, drive
from ospc.correction.folder import CorrectedFolder
from ospc.correction.recording import correct_recording
from ospc.correction.settings import CorrectionSettings
from ospc.correction.source import Source
from ospc.diagnosis import check_recording
from ospc.evaluation.tracking import compare_tracking
from ospc.formats.opening import Photometry
from ospc.live import LiveCalibrator
from ospc.photometry.calibration import Calibration
from ospc.photometry.correction import Corrector
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import ArrayRecording, Frame, Recording, open_recording
from ospc.recording.recording import identity
from ospc.recording.stream import frames_of
from ospc.recording.writing.conversion import convert_recording
from ospc.report.examples import examples_of
from ospc.simulation import SimulatedRecording, SimulationSettings, simulate

UNKNOWN = 5
REASON = "its exposure is unknown"
SETTINGS = SimulationSettings(
    size=(160, 128), frames=16, exposure="cycle", exposures_ms=(3.0, 6.0, 12.0, 24.0), vignette="none"
)


def calibration_of_size() -> Calibration:
    vignette = PolynomialVignette(SETTINGS.size, (-0.3, 0.1, -0.1))
    return replace(calibration(size=SETTINGS.size, vignette=False), vignette=vignette)


Road = Callable[[Recording], tuple[Calibration, tuple[str, ...]]]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A folder whose times.txt has one NaN as exposure."""
    made: SimulatedRecording = simulate(tmp_path_factory.mktemp("without") / "recording", SETTINGS)
    times = made.path / "times.txt"
    lines = times.read_text().splitlines()
    lines[UNKNOWN] = " ".join([*lines[UNKNOWN].split()[:2], "nan"])
    times.write_text("\n".join(lines))
    return open_recording(made.path)


def pushed(frames: Iterator[Frame] | Recording) -> tuple[Calibration, tuple[str, ...]]:
    calibrator = OnlineCalibrator()
    drive(calibrator, frames)
    return calibrator.calibration(), calibrator.first_reasons


def in_memory(recording: Recording) -> tuple[Calibration, tuple[str, ...]]:
    images = [frame.image for frame in recording]
    return pushed(ArrayRecording(images, recording.exposures_ms, recording.stamps_s))


def tuples(unknown: float | None, recording: Recording) -> tuple[Calibration, tuple[str, ...]]:
    made = ((f.image, unknown if f.index == UNKNOWN else f.exposure_ms, f.stamp_s) for f in recording)
    return pushed(frames_of(made))


def live(recording: Recording) -> tuple[Calibration, tuple[str, ...]]:
    with LiveCalibrator() as calibrator:
        for frame in recording:
            calibrator.push(frame)
        return calibrator.calibration(), calibrator.first_reasons


ROADS: dict[str, Road] = {
    "arrays": in_memory,
    "tuples with None": partial(tuples, None),
    "tuples with NaN": partial(tuples, float("nan")),
    "a live camera": live,
}


@pytest.fixture(scope="module")
def from_folder(recording: Recording) -> tuple[Calibration, tuple[str, ...]]:
    return pushed(recording)


def test_the_others_are_calibrated(from_folder: tuple[Calibration, tuple[str, ...]]) -> None:
    found, reasons = from_folder
    assert found.response is not None
    assert (found.counts["frames"], found.counts["skipped"]) == (SETTINGS.frames, 1)
    assert [reason.endswith(REASON) for reason in reasons] == [True]


@pytest.mark.parametrize("road", ROADS)
def test_every_road_gives_the_same(
    road: str, recording: Recording, from_folder: tuple[Calibration, tuple[str, ...]]
) -> None:
    (expected, _), (found, reasons) = from_folder, ROADS[road](recording)
    assert expected.response is not None
    assert found.response is not None
    np.testing.assert_array_equal(found.response.inverse_table, expected.response.inverse_table)
    assert found.counts == expected.counts
    assert [reason.endswith(REASON) for reason in reasons] == [True]


def test_a_check_uses_the_same_words(recording: Recording) -> None:
    notes = check_recording(recording).notes
    assert sum(note.startswith("1 of 16 frames skipped") and note.endswith(REASON) for note in notes) == 1


def test_it_is_left_out_of_what_is_written(recording: Recording, tmp_path: Path) -> None:
    converted = convert_recording(recording, tmp_path / "converted")
    assert any("1 frame left out" in note and REASON in note for note in converted.notes)
    known = calibration_of_size()
    corrected = correct_recording(
        Source(recording),
        Photometry("made", known.response, known.vignette),
        CorrectedFolder.at(tmp_path / "corrected", recording.path),
        CorrectionSettings(output="grey8", normalise_exposure=True),
    )
    assert UNKNOWN not in corrected.frames
    assert REASON in corrected.reasons[0]
    for folder in (converted.path, corrected.path):
        assert len(open_recording(folder)) == SETTINGS.frames - 1


def test_the_report_shows_the_others(recording: Recording) -> None:
    known = calibration_of_size()
    corrector = Corrector(known.response, known.vignette)
    tracking, shown = compare_tracking(recording, corrector), examples_of(known, recording)
    assert (tracking.frames, tracking.skipped) == (SETTINGS.frames - 1, 1)
    assert shown.pictures
    assert shown.notes == ()


def test_a_recording_is_identified(recording: Recording) -> None:
    assert identity(recording)["exposure_range_ms"] == [3.0, 24.0]
