"""A calibration with progress, interruption and checkpoints, as commands run it."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from ospc.calibrator import OnlineCalibrator, Status, drive
from ospc.cli.calibration_result import CalibrationOutcome, ResultFolder, Save
from ospc.cli.terminal import progress_line, say, say_notes, spreads_in_words
from ospc.errors import FormatError, OspcError, SettingError, counted, one_line
from ospc.exposures.lag_choice import LagChoice
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.recording import Frame, Recording
from ospc.report.drawing import drawing_process
from ospc.report.output_folder import OutputFolder
from ospc.settings import Settings, as_dict
from ospc.state.container import STATE_NAME
from ospc.system.throttle import Throttle
from ospc.system.versions import versions

_EVERY_S, _LARGEST_SHARE = 5.0, 0.02
"""Seconds between checkpoints, and largest share of the time spent on them, unless the user states an interval."""

_SAME = ("frames", "size", "frames_sha256", "images_sha256")


class Checkpoints:
    """Writes the state of one run into its output folder, if it is ``wanted`` and the method has a state.

    Before the end of the run, it does not replace the state of a complete result.

    It is written every ``every_s`` seconds, or after every frame for 0; by default, as often as is cheap. ``resume``
    continues from an existing one. ``prior`` is an earlier calibration of the camera.
    """

    def __init__(
        self,
        folder: OutputFolder,
        every_s: float | None = None,
        *,
        resume: bool = False,
        prior: PriorCalibration | None = None,
        wanted: bool = True,
    ) -> None:
        self.place = folder.for_partial_results.path / STATE_NAME
        self._before = self.place if self.place.exists() else folder.path / STATE_NAME
        self.notes: list[str] = []
        """Notes on the state of this run."""
        self._resume, self._prior, self._kept = resume, prior, wanted
        self._throttle = Throttle(_EVERY_S, _LARGEST_SHARE) if every_s is None else Throttle(every_s, math.inf)
        self._failed = False

    def resumed(self, calibrator: OnlineCalibrator) -> OnlineCalibrator:
        """Return the given new calibrator, or one with the same settings and source loaded from the checkpoint.

        FormatError if the checkpoint is damaged, SettingError if it belongs to another recording or other settings.
        """
        with self._throttle.timed():
            pass  # start the interval: the first checkpoint is due at its end
        self._kept = self._kept and calibrator.settings.state_type() is not None
        if not self._kept:
            if self._resume:
                name = calibrator.settings.name
                raise SettingError(f"--resume: preset {name} has no checkpoints; leave --resume out")
            return calibrator
        if self._resume and self._before.exists():
            calibrator = self._loaded(calibrator)
        elif self._resume:
            self.notes.append(f"{self._before.parent} contains no checkpoint yet: starting with the first frame")
        calibrator.prior = self._prior
        return calibrator

    def after_frame(self, calibrator: OnlineCalibrator) -> None:
        """Save the state if a checkpoint is due."""
        if self._throttle.due and not self._failed:
            with self._throttle.timed():
                self.save(calibrator)

    def at_the_end(self, calibrator: OnlineCalibrator) -> Save | None:
        """Return the function that saves the final state, with the summary needed for merging; None if unwanted."""
        return partial(calibrator.save_state, complete=True) if self._kept else None

    def save(self, calibrator: OnlineCalibrator) -> None:
        """Save the state, if wanted."""
        if not self._kept:
            return
        try:
            self.place.parent.mkdir(parents=True, exist_ok=True)
            calibrator.save_state(self.place)
        except (OSError, FormatError) as error:
            # Continue: the result matters more than the ability to resume.
            self._failed = True
            self.notes.append(f"no checkpoint was saved: {error}")

    def _loaded(self, new: OnlineCalibrator) -> OnlineCalibrator:
        found = OnlineCalibrator.load_state(self._before)
        start_anew = "omit --resume to start again"
        if [found.source.get(name) for name in _SAME] != [new.source.get(name) for name in _SAME]:
            name = found.source.get("name", "a live camera")
            other = f"belongs to another recording ({name}), or to other exposures or another part of this one"
            raise SettingError(f"{self._before}: {other}; {start_anew}")
        before, now = (as_dict(one.settings) | {"--correct-lag": one.correct_lag} for one in (found, new))
        changed = [
            f"{name} {before.get(name)} instead of {value}"
            for name, value in now.items()
            if before.get(name) != value
        ]
        if changed:
            raise SettingError(f"{self._before}: was made with other settings ({', '.join(changed)}); {start_anew}")
        self.notes.append(f"continuing after frame {found.frames} from {self._before}")
        others = [f"{name} {made}" for name, made in found.saved_by.items() if made != versions().get(name)]
        if others:
            names = ", ".join(others)
            self.notes.append(f"the state was saved with {names}: the result may differ in the last digits")
        found.source = new.source
        return found


@dataclass(frozen=True)
class CalibrationRun:
    """A recording to calibrate, with its result folder, checkpoints and display.

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

        ``exit_code`` and ``error`` describe how it ended; after a failure, a partial result is written.
        OspcError if nothing could be estimated, KeyboardInterrupt if the user interrupted it before anything was
        written.
        """
        if self.result.prints_text:
            say_notes(self.recording.notes)
        result = replace(self.result, second=drawing_process())
        with self.result.interruption.deferred():
            calibrator, outcome = self._estimated()
            return result.take(outcome, self.checkpoints.at_the_end(calibrator), self.checkpoints.notes)

    def _estimated(self) -> tuple[OnlineCalibrator, CalibrationOutcome]:
        """Calibrate; an interruption or a failure keeps all earlier observations."""
        visible = not self.result.quiet and sys.stderr.isatty()
        with ExitStack() as stack:
            stream = None
            if self.viewer or self.stream is not None:
                from ospc.cli.rerun_stream import RerunStream

                stream = stack.enter_context(RerunStream.opened(self.recording, self.stream, spawn=self.viewer))
            bar = stack.enter_context(progress_line(quiet=not visible))
            calibrator = OnlineCalibrator.of(self.recording, self.settings, correct_lag=self.correct_lag)
            calibrator = self.checkpoints.resumed(calibrator)

            def show(stage: str, done: int = 0, total: int = 0) -> None:
                if visible:  # avoids computing the status otherwise
                    bar(stage, done, total, figures(calibrator.status))

            def after(frame: Frame, used: bool) -> None:
                if stream is not None and used:
                    stream(calibrator, frame)
                show("comparing", calibrator.frames, len(self.recording))
                self.checkpoints.after_frame(calibrator)
                self.result.interruption.check()

            failure = self._push_all(calibrator, after)
            early = self.result.interruption.requested
            if early:  # a second interruption then loses no frame
                self.checkpoints.save(calibrator)
            show("estimating")
            if early and not self.result.quiet:
                frames = counted(calibrator.frames, "frame")
                say(f"interrupted: estimating from {frames}; press Ctrl-C again to stop without a result", err=True)
            try:
                calibration = calibrator.calibration()
            except Exception as error:
                if early:
                    raise KeyboardInterrupt(one_line(error)) from error
                raise OspcError(failure or one_line(error)) from error
        stopped = self.result.interruption.requested
        calibration = replace(calibration, partial=stopped or bool(failure))
        *ended, _ = calibrator.epochs
        reasons = calibrator.first_reasons
        return calibrator, CalibrationOutcome(calibration, self.recording, reasons, stopped, failure, tuple(ended))

    def _push_all(self, calibrator: OnlineCalibrator, after: Callable[[Frame, bool], None]) -> str:
        """Push frames until the end or an interruption, and return the error message, if any."""
        try:
            drive(calibrator, self.recording, after)
        except KeyboardInterrupt:
            pass  # estimate from the frames so far
        except Exception as error:  # estimate from the frames before the error
            return one_line(error)
        return ""


def figures(status: Status) -> str:
    """Return the method's own figures in one line."""
    now = status.progress
    return "  ".join([counted(now.pairs, "pair"), *spreads_in_words(now.response_sigma, now.vignette_sigma)])
