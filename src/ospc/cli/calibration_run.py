"""One calibration as commands run it: visible, interruptible, and never in vain."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from threading import Thread
from typing import TYPE_CHECKING, Any

from ospc.cli.calibration_report import say_notes
from ospc.cli.calibration_result import Outcome, ResultFolder, Saved
from ospc.cli.interruption import Interruption, leaving
from ospc.cli.progress import COMPARING, Watcher, Watching
from ospc.cli.terminal import say
from ospc.errors import OspcError, counted, one_line

if TYPE_CHECKING:
    from ospc.calibrator import OnlineCalibrator
    from ospc.cli.checkpoints import Checkpoints
    from ospc.exposures.findings import LagChoice
    from ospc.photometry.calibration import Calibration
    from ospc.recording import Frame, Recording
    from ospc.settings import Settings


@dataclass(frozen=True)
class CalibrationRun:
    """What to calibrate, where the result and checkpoints (None for none) go, and how the run is watched."""

    recording: Recording
    settings: Settings
    result: ResultFolder
    checkpoints: Checkpoints | None = None
    correct_lag: LagChoice = "auto"
    watching: Watching = field(default_factory=Watching)

    @property
    def interruption(self) -> Interruption:
        """Tells when to stop."""
        return self.result.interruption

    def calibrate(self) -> dict[str, Any]:
        """Calibrate, write the folder, print the result, and return it as JSON-compatible values.

        The values ``exit_code`` and ``error`` say how it ended; after a failure, a partial result is written.

        Raises
        ------
        OspcError
            If nothing could be estimated.
        KeyboardInterrupt
            If the user gave up before anything was written.
        """
        if self.result.talkative:
            say_notes(self.recording.notes)
        load_drawing()
        with leaving("no result was written"), self.interruption.deferred():
            calibrator, outcome = self._estimated()
            with ThreadPoolExecutor(1, "ospc-state") as second:
                # Most of it is compression, which leaves the interpreter to those who draw.
                saving = second.submit(self._saved, calibrator)
                return self.result.take(outcome, saving.result)

    def _saved(self, calibrator: OnlineCalibrator) -> Saved:
        """Save the final state."""
        from ospc.output import Written

        if self.checkpoints is None:
            return Written(), []
        self.checkpoints.at_the_end(calibrator)
        return Written((self.checkpoints.place,) if self.checkpoints.saved else ()), self.checkpoints.notes

    def _estimated(self) -> tuple[OnlineCalibrator, Outcome]:
        """Calibrate; nothing observed before an interruption or a failure is lost."""
        from ospc.calibrator import OnlineCalibrator
        from ospc.unknown_exposures import labelled

        watching = replace(self.watching, visible=not self.result.quiet and sys.stderr.isatty())
        with watching.of(self.recording) as show, self.interruption.deferred():
            calibrator = OnlineCalibrator.of(self.recording, self.settings, correct_lag=self.correct_lag)
            calibrator.source = identification(self.recording)
            if self.checkpoints is not None:
                calibrator = self.checkpoints.resumed(calibrator)
            failure = self._push_all(calibrator, show)
            early = self.interruption.requested
            if early and self.checkpoints is not None:
                self.checkpoints.before_estimating(calibrator)
            show(calibrator, "estimating", None)
            if early and not self.result.quiet:
                frames = calibrator.status.frames
                say(f"interrupted: estimating from {counted(frames, 'frame')}; Ctrl-C again gives up", err=True)
            calibration = labelled(_estimate(calibrator, failure, early=early), self.recording)
        stopped = self.interruption.requested
        calibration = replace(calibration, partial=stopped or bool(failure))
        return calibrator, Outcome(calibration, calibrator.first_reasons, stopped, failure)

    def _push_all(self, calibrator: OnlineCalibrator, show: Watcher) -> str:
        """Push frames until their end or an interruption, and return what went wrong."""
        from ospc.calibrator import drive

        def after(frame: Frame, used: bool) -> None:
            show(calibrator, COMPARING, frame if used else None)
            if self.checkpoints is not None:
                self.checkpoints.after_frame(calibrator)
            self.interruption.check()

        try:
            drive(calibrator, self.recording, after)
        except KeyboardInterrupt:
            pass  # estimate from the frames so far
        except Exception as error:  # the frames before any error still give an estimate
            return one_line(error)
        return ""


def load_drawing() -> None:
    """Load the modules that draw while frames are compared, for which two cores are not needed all the time."""

    def load() -> None:
        from ospc.report import style

        style.load()

    Thread(target=load, daemon=True).start()


def _estimate(calibrator: OnlineCalibrator, failure: str, *, early: bool) -> Calibration:
    """Return the estimate from the frames pushed so far."""
    try:
        return calibrator.calibration()
    except Exception as error:
        if early:
            raise KeyboardInterrupt(one_line(error)) from error
        raise OspcError(failure or one_line(error)) from error


def identification(recording: Recording) -> dict[str, Any]:
    """Return what tells a recording from others."""
    from ospc.recording import identity

    try:
        return identity(recording)
    except Exception as error:  # calibrate even if the recording cannot be identified
        return {"kind": recording.kind, "name": recording.path.name, "problem": one_line(error)}
