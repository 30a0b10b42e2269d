"""Checks a recording: runs the engine, and reports figures on everything that could spoil a calibration."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

from ospc.calibrator import OnlineCalibrator, drive
from ospc.diagnosis.motion import motion
from ospc.diagnosis.notes import notes
from ospc.diagnosis.report import RecordingReport
from ospc.diagnosis.timing import timing
from ospc.errors import RecordingError
from ospc.exposures.findings import LagChoice
from ospc.recording.frame import Frame
from ospc.recording.recording import Recording
from ospc.unknown_exposures import labelled


def check_recording(
    recording: Recording,
    *,
    frames: int | None = None,
    correct_lag: LagChoice = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> RecordingReport:
    """Report what a calibration of a recording finds, and what is wrong with the recording.

    The frames go through the same engine as for a calibration: the verdicts are those of
    :func:`~ospc.calibrator.calibrate`.

    Parameters
    ----------
    recording
        The recording.
    frames
        Number of frames used, from the beginning; None for all.
    correct_lag
        What to do about a lag of the exposures, as in :func:`~ospc.calibrator.calibrate`.
    progress
        Called after every frame with the number of frames taken and of all.

    Returns
    -------
    RecordingReport
        Figures, notes, and a verdict on response, vignette and exposures.

    Raises
    ------
    RecordingError
        If none of the frames can be used.
    """
    total = min(frames or len(recording), len(recording))
    calibrator = OnlineCalibrator.of(recording, correct_lag=correct_lag)

    def count(_frame: Frame, _used: bool) -> None:
        if progress is not None:
            progress(calibrator.frames, total)

    drive(calibrator, islice(recording, total), count)
    return report_of(calibrator, recording, total)


def report_of(calibrator: OnlineCalibrator, recording: Recording, frames: int) -> RecordingReport:
    """Return the report on a recording of which ``frames`` frames were pushed.

    Raises
    ------
    RecordingError
        If none of them could be used.
    """
    evidence, pixels = calibrator.evidence, calibrator.pixels.report()
    if evidence is None or pixels is None:
        why = calibrator.first_reasons[0] if calibrator.first_reasons else "there are none"
        raise RecordingError(f"{recording.path}: none of its frames can be used; the first: {why}")
    found, calibration = calibrator.exposure_findings(), labelled(calibrator.calibration(), recording)
    when = timing(recording.stamps_s[:frames], evidence.repeated, evidence.compared)
    told = notes(found, pixels, when, calibration.counts["skipped"])
    return RecordingReport(
        name=recording.path.name or recording.path.resolve().name,
        kind=recording.kind,
        frames=len(recording),
        size=recording.size,
        max_grey=recording.max_grey,
        processed=calibrator.processed,
        unreadable=calibration.counts["skipped"],
        exposures=found,
        pixels=pixels,
        timing=when,
        motion=motion(evidence.changes, calibrator.inputs()),
        verdicts=calibration.verdicts,
        complete=calibration.complete,
        notes=(*calibration.warnings, *calibration.notes, *told, *recording.notes),
    )
