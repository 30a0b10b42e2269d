"""The check of exposures that precedes a calibration: cheap where all is well, thorough where it is not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ospc.diagnosis.check import DEFAULT_FRAMES, check_recording
from ospc.diagnosis.report import RecordingReport
from ospc.diagnosis.shifted import with_exposure_lag
from ospc.photometry.calibration import Verdict
from ospc.recording.recording import Recording

FIRST_FRAMES = 40
"""Frames looked at first."""

_AMONG = 400

LagChoice = int | Literal["auto", "never"]


@dataclass(frozen=True)
class Examined:
    """A recording that is about to be calibrated, its exposures where they belong.

    Attributes
    ----------
    recording
        The recording, corrected or as it was.
    lag_frames
        By how many frames its metadata come late; None where that cannot be determined.
    corrected_frames
        The lag it was corrected by; 0 for none.
    notes
        What was found and done.
    warnings
        Why the exposures, as they are used now, cannot be relied on; empty where nothing speaks against them.
    remedy
        What to do about that.
    """

    recording: Recording
    lag_frames: int | None
    corrected_frames: int
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    remedy: str = ""

    def judged(self, verdicts: dict[str, Verdict]) -> dict[str, Verdict]:
        """Return verdicts on quantities found, marginal at best where exposures cannot be relied on."""
        if not self.warnings:
            return verdicts
        why = "; ".join(self.warnings)
        return {
            name: Verdict("marginal", f"{verdict.reason}, but {why}", self.remedy) if verdict.known else verdict
            for name, verdict in verdicts.items()
        }


def examine(recording: Recording, correct_lag: LagChoice = "auto") -> Examined:
    """Check the exposures of a recording, and move them to the frames they belong to.

    Forty frames are looked at, several hundred only where these leave doubts.

    Parameters
    ----------
    recording
        The recording.
    correct_lag
        ``"auto"`` to correct a lag that is certain, ``"never"``, or the number of frames to correct by.

    Returns
    -------
    Examined
        The recording to calibrate, and what to say about it.

    Raises
    ------
    SettingError
        If so large a lag leaves no frames.
    RecordingError
        If none of the frames looked at can be read.
    """
    if isinstance(correct_lag, int):
        moved = with_exposure_lag(recording, correct_lag)
        report = _check(moved)
        left = report.exposure_lag_frames
        lag = None if left is None else left + correct_lag
        return Examined(moved, lag, correct_lag, (), *_doubts(report))
    report = _check(recording)
    lag = report.exposure_lag_frames
    certain = report.lag.correction(report.exposure.cycle_frames)
    if certain and correct_lag == "auto":
        found = (
            f"exposures are written {_frames(certain)} {'late' if certain > 0 else 'early'}, as {report.lag.pairs} "
            f"pairs of frames say, and were moved to where they belong; --correct-lag never leaves them"
        )
        return Examined(with_exposure_lag(recording, certain), lag, certain, (found,))
    return Examined(recording, lag, 0, _open_questions(report), *_doubts(report))


def _open_questions(report: RecordingReport) -> tuple[str, ...]:
    """Return that the lag is not known, where exposures change and none of them is unlikely to be right."""
    lag, verdict = report.lag, report.verdicts["exposures"]
    if lag.frames is not None or verdict.state != "marginal" or _doubts(report)[0]:
        return ()
    return (f"whether exposures belong to their frames is not certain: {verdict.reason}",)


def _check(recording: Recording) -> RecordingReport:
    first = check_recording(recording, frames=FIRST_FRAMES, among=_AMONG)
    settled = first.verdicts["exposures"].state == "identifiable"
    if settled or len(recording) <= FIRST_FRAMES:
        return first
    return check_recording(recording, frames=DEFAULT_FRAMES)


def _doubts(report: RecordingReport) -> tuple[tuple[str, ...], str]:
    """Return why exposures cannot be relied on, and what to do; nothing where they may be right."""
    verdict, lag = report.verdicts["exposures"], report.lag
    late = bool(lag.candidates) and 0 not in lag.candidates
    if verdict.known and not late:
        return (), ""
    remedy = verdict.remedy if lag.frames is None else f"leave --correct-lag at auto, or set it to {lag.frames}"
    return (verdict.reason,), remedy


def _frames(number: int) -> str:
    return f"{abs(number)} frame{'' if abs(number) == 1 else 's'}"
