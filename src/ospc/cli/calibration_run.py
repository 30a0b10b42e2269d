"""One calibration as commands run it: visible, interruptible, and never in vain."""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread
from typing import Any

from ospc.calibrator import OnlineCalibrator, Status, drive
from ospc.cli.calibration_result import Outcome, ResultFolder, Saved
from ospc.cli.checkpoints import Checkpoints
from ospc.cli.interruption import leaving
from ospc.cli.progress import progress_line
from ospc.cli.terminal import say, say_notes
from ospc.errors import OspcError, counted, one_line
from ospc.exposures.lag_choice import LagChoice
from ospc.output import Written
from ospc.recording import Frame, Recording, identity
from ospc.report import style
from ospc.settings import Settings
from ospc.unknown_exposures import labelled


@dataclass(frozen=True)
class CalibrationRun:
    """What to calibrate, where the result and checkpoints go, and how the run is watched.

    ``viewer`` opens the Rerun viewer, and ``stream`` is a file for it.
    """

    recording: Recording
    settings: Settings
    result: ResultFolder
    checkpoints: Checkpoints
    correct_lag: LagChoice = "auto"
    viewer: bool = False
    stream: Path | None = None

    def calibrate(self) -> dict[str, Any]:
        """Calibrate, write the folder, print the result, and return it as JSON-compatible values.

        The values ``exit_code`` and ``error`` say how it ended; after a failure, a partial result is written.
        OspcError if nothing could be estimated, KeyboardInterrupt if the user gave up before anything was written.
        """
        if self.result.talkative:
            say_notes(self.recording.notes)
        load_drawing()
        with leaving("no result was written"), self.result.interruption.deferred():
            calibrator, outcome = self._estimated()
            with ThreadPoolExecutor(1, "ospc-state") as second:
                # Most of it is compression, which leaves the interpreter to those who draw.
                saving = second.submit(self._saved, calibrator)
                return self.result.take(outcome, saving.result)

    def _saved(self, calibrator: OnlineCalibrator) -> Saved:
        """Save the final state."""
        self.checkpoints.at_the_end(calibrator)
        return Written((self.checkpoints.place,) if self.checkpoints.saved else ()), self.checkpoints.notes

    def _estimated(self) -> tuple[OnlineCalibrator, Outcome]:
        """Calibrate; nothing observed before an interruption or a failure is lost."""
        visible = not self.result.quiet and sys.stderr.isatty()
        with ExitStack() as stack:
            stream = None
            if self.viewer or self.stream is not None:
                from ospc.cli.rerun_stream import RerunStream

                stream = stack.enter_context(RerunStream.opened(self.recording, self.stream, spawn=self.viewer))
            bar = stack.enter_context(progress_line(quiet=not visible))
            calibrator = OnlineCalibrator.of(self.recording, self.settings, correct_lag=self.correct_lag)
            calibrator.source = identification(self.recording)
            calibrator = self.checkpoints.resumed(calibrator)

            def show(stage: str, done: int = 0, total: int = 0) -> None:
                if visible:  # the status is not even asked for where nobody looks
                    bar(stage, done, total, figures(calibrator.status))

            def after(frame: Frame, used: bool) -> None:
                if stream is not None and used:
                    stream(calibrator, frame)
                show("comparing", calibrator.frames, len(self.recording))
                self.checkpoints.after_frame(calibrator)
                self.result.interruption.check()

            failure = self._push_all(calibrator, after)
            early = self.result.interruption.requested
            if early:
                self.checkpoints.before_estimating(calibrator)
            show("estimating")
            if early and not self.result.quiet:
                frames = counted(calibrator.frames, "frame")
                say(f"interrupted: estimating from {frames}; Ctrl-C again gives up", err=True)
            try:
                calibration = calibrator.calibration()
            except Exception as error:
                if early:
                    raise KeyboardInterrupt(one_line(error)) from error
                raise OspcError(failure or one_line(error)) from error
        stopped = self.result.interruption.requested
        calibration = replace(labelled(calibration, self.recording), partial=stopped or bool(failure))
        return calibrator, Outcome(calibration, calibrator.first_reasons, stopped, failure)

    def _push_all(self, calibrator: OnlineCalibrator, after: Callable[[Frame, bool], None]) -> str:
        """Push frames until their end or an interruption, and return what went wrong."""
        try:
            drive(calibrator, self.recording, after)
        except KeyboardInterrupt:
            pass  # estimate from the frames so far
        except Exception as error:  # the frames before any error still give an estimate
            return one_line(error)
        return ""


def figures(status: Status) -> str:
    """Return the method's own figures in one line."""
    sigmas = {"g": status.progress.response_sigma, "V": status.progress.vignette_sigma}
    known = [f"{name} ±{sigma:.2g}" for name, sigma in sigmas.items() if sigma is not None]
    return "  ".join([counted(status.progress.pairs, "pair"), *known])


def load_drawing() -> None:
    """Load the modules that draw while frames are compared, for which two cores are not needed all the time."""
    Thread(target=style.load, daemon=True).start()


def identification(recording: Recording) -> dict[str, Any]:
    """Return what tells a recording from others."""
    try:
        return identity(recording)
    except Exception as error:  # calibrate even if the recording cannot be identified
        return {"kind": recording.kind, "name": recording.path.name, "problem": one_line(error)}
