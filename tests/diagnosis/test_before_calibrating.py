"""The check before a calibration: little work where all is well, and no silence where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from filmed import Film, wandering

from ospc.diagnosis import before_calibrating
from ospc.diagnosis.before_calibrating import FIRST_FRAMES, examine
from ospc.photometry.calibration import Verdict
from ospc.recording import ArrayRecording

FRAMES = 70
KNOWN, UNKNOWN = Verdict("identifiable", "it was seen"), Verdict("not identifiable", "nothing moved", "move")


@pytest.fixture(scope="module")
def late() -> ArrayRecording:
    return Film(wandering(FRAMES), lag=2).recording()


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many frames each check looked at."""
    found: list[int] = []
    check = before_calibrating.check_recording

    def counted(*arguments, **options):
        report = check(*arguments, **options)
        found.append(len(report.looked_at))
        return report

    monkeypatch.setattr(before_calibrating, "check_recording", counted)
    return found


def test_where_all_is_well_few_frames_are_looked_at_and_nothing_is_said(looks: list[int]) -> None:
    recording = Film(wandering(FRAMES)).recording()
    found = examine(recording)
    assert found.recording is recording
    assert (found.lag_frames, found.corrected_frames, found.notes, found.warnings) == (0, 0, (), ())
    assert looks == [FIRST_FRAMES]
    verdicts = {"response": KNOWN, "vignette": UNKNOWN}
    assert found.judged(verdicts) == verdicts


def test_a_lag_is_corrected_after_a_thorough_look_and_told(late: ArrayRecording, looks: list[int]) -> None:
    found = examine(late)
    assert (found.lag_frames, found.corrected_frames, found.warnings) == (2, 2, ())
    assert len(found.recording) == FRAMES - 2
    assert "2 frames late" in found.notes[0]
    assert looks == [FIRST_FRAMES, FRAMES]


def test_a_lag_that_is_not_to_be_corrected_is_a_warning(late: ArrayRecording) -> None:
    found = examine(late, "never")
    assert found.recording is late
    assert (found.lag_frames, found.corrected_frames) == (2, 0)
    assert "2 frames late" in found.warnings[0]
    judged = found.judged({"response": KNOWN, "vignette": UNKNOWN})
    assert judged["response"].state == "marginal"
    assert "2 frames late" in judged["response"].reason
    assert judged["vignette"] == UNKNOWN


def test_a_number_is_obeyed_and_checked(late: ArrayRecording) -> None:
    right, wrong = examine(late, 2), examine(late, -1)
    assert (right.lag_frames, right.corrected_frames, right.warnings) == (2, 2, ())
    assert (wrong.lag_frames, wrong.corrected_frames) == (2, -1)
    assert "3 frames late" in wrong.warnings[0]


def test_a_short_cycle_is_corrected_whichever_lag_it_is() -> None:
    exposures = np.log([1.0, 2.0, 4.0])[np.arange(FRAMES) % 3] - 1
    true = Film(exposures).recording()
    found = examine(Film(exposures, lag=1).recording())
    assert (found.lag_frames, found.corrected_frames) == (None, 1)
    np.testing.assert_allclose(found.recording.exposures_ms, true.exposures_ms[: FRAMES - 1])


def test_stale_exposures_are_a_warning() -> None:
    found = examine(Film(np.zeros(FRAMES), hidden_log_gain=wandering(FRAMES)).recording())
    assert "stale" in found.warnings[0]
    assert found.remedy
    assert found.corrected_frames == 0


def test_constant_exposures_that_are_true_are_none() -> None:
    found = examine(Film(np.zeros(60)).recording())
    assert (found.lag_frames, found.notes, found.warnings) == (None, (), ())


def test_what_is_open_is_said_without_alarm() -> None:
    found = examine(Film(np.linspace(-0.6, 0.6, 60)).recording())
    assert found.lag_frames is None
    assert found.warnings == ()
    assert "not certain" in found.notes[0]


def test_without_decoding_far_into_a_long_recording_if_its_beginning_tells_enough(looks: list[int]) -> None:
    recording = Film(wandering(60)).recording()
    long = ArrayRecording(
        [frame.image for frame in recording] * 8, np.tile(recording.exposures_ms, 8), np.arange(480) / 20
    )
    before_calibrating.check_recording(long, frames=20, among=50)
    assert looks == [20]
    report = before_calibrating.check_recording(long, frames=20, among=50)
    assert max(report.looked_at) < 50
