"""One calibration as commands run it: visible, interruptible, and never in vain."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from threading import Thread
from typing import TYPE_CHECKING, Any

from ospc.cli.calibration_report import result_as_dict, say_notes, say_result
from ospc.cli.interruption import INTERRUPTED, Interruption, leaving
from ospc.cli.live import COMPARING, Watcher, Watching
from ospc.cli.options import COMPLETE, UNDETERMINED
from ospc.cli.progress import progress_line
from ospc.cli.terminal import say, styled
from ospc.errors import OspcError, one_line

if TYPE_CHECKING:
    from ospc.calibrator import OnlineCalibrator
    from ospc.cli.checkpoints import Checkpoints
    from ospc.exposures.findings import LagChoice
    from ospc.formats.opening import Photometry
    from ospc.output import OutputFolder, Written
    from ospc.photometry.calibration import Calibration
    from ospc.recording import Frame, Recording
    from ospc.settings import Settings

FAILED = 1
"""Exit code of a run that failed, though what was known by then is written."""


@dataclass(frozen=True)
class CalibrationRun:
    """What to calibrate, and how it is watched and reported.

    Attributes
    ----------
    recording, settings, folder
        The recording, the settings of the method, and where the result goes.
    interruption
        Tells when to stop.
    quiet, as_json
        Whether to print only errors; whether somebody else prints the result as JSON.
    truth
        What to compare with.
    checkpoints
        Where states are saved, and whether to go on from one; None for nowhere.
    correct_lag
        What to do about a lag of the exposures.
    watching
        How the run is watched, where somebody looks at a terminal.
    pdf
        Whether to write the report as PDF too.
    """

    recording: Recording
    settings: Settings
    folder: OutputFolder
    interruption: Interruption
    quiet: bool = False
    as_json: bool = False
    truth: Photometry | None = None
    checkpoints: Checkpoints | None = None
    correct_lag: LagChoice = "auto"
    watching: Watching = field(default_factory=Watching)
    pdf: bool = False

    def calibrate(self) -> dict[str, Any]:
        """Calibrate, write the folder, print the result, and return it as JSON-compatible values.

        The values ``exit_code`` and ``error`` say how it ended; what was known before a failure is written.

        Raises
        ------
        OspcError
            If nothing at all could be estimated.
        KeyboardInterrupt
            If the user gave up before anything was written.
        """
        from ospc.output import Written

        if not self.quiet and not self.as_json:
            say_notes(self.recording.notes)
        Thread(target=_load_drawing, daemon=True).start()
        with leaving("no result was written"), self.interruption.deferred():
            outcome = self._estimated()
            with self.interruption.held():
                with progress_line(quiet=self.quiet) as show_writing:
                    show_writing("writing", 0, 0)
                    outcome, written = self._written(outcome)
                if self.checkpoints is not None and self.checkpoints.saved:
                    written += Written((self.checkpoints.place,))
                self._say(outcome, written)
                return self._as_dict(outcome, written)

    def _estimated(self) -> _Outcome:
        """Calibrate; what was seen before an interruption or a failure is not lost."""
        from ospc.calibrator import OnlineCalibrator
        from ospc.unknown_exposures import labelled

        watching = replace(self.watching, visible=not self.quiet and sys.stderr.isatty())
        with watching.of(self.recording) as show, self.interruption.deferred():
            calibrator = OnlineCalibrator(self.settings, correct_lag=self.correct_lag)
            calibrator.source = _identity(self.recording)
            if self.checkpoints is not None:
                calibrator = self.checkpoints.resumed(calibrator)
            failure = self._push_all(calibrator, show)
            early = self.interruption.requested
            if early and self.checkpoints is not None:
                self.checkpoints.before_estimating(calibrator)
            show(calibrator, "estimating", None)
            if early and not self.quiet:
                frames = calibrator.status.frames
                say(f"interrupted: estimating from {frames} frames; Ctrl-C again gives up", err=True)
            calibration = labelled(_estimate(calibrator, failure, early=early), self.recording)
            if self.checkpoints is not None:
                self.checkpoints.at_the_end(calibrator)
        stopped = self.interruption.requested
        calibration = replace(calibration, partial=stopped or bool(failure))
        return _Outcome(calibration, calibrator.first_reasons, stopped, failure)

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
            pass  # what there is will be estimated
        except Exception as error:  # whatever it is, the frames before it are worth an estimate
            return one_line(error)
        return ""

    def _written(self, outcome: _Outcome) -> tuple[_Outcome, Written]:
        """Write data, report, then pictures; an interruption now only leaves out pictures."""
        folder, before = self.folder, self.interruption.count
        written = folder.write(outcome.calibration, self.recording)
        if not written.problems:
            with ThreadPoolExecutor(1) as second:
                # The report follows points through images, which leaves the interpreter to whoever draws.
                report = second.submit(folder.report, outcome.calibration, self.recording, self.truth, pdf=self.pdf)
                if self.pdf:
                    report.result()  # drawn as the pictures are, which is not to be done twice at once
                drawn = folder.draw(outcome.calibration, self.truth, stop=lambda: self.interruption.count > before)
                written += report.result() + drawn
        if self.interruption.requested and not outcome.interrupted:
            unfinished = replace(outcome.calibration, partial=True)
            unfinished.save(folder.path / "calibration.json")
            outcome = replace(outcome, calibration=unfinished, interrupted=True)
        failure = "; ".join(filter(None, (outcome.failure, *written.problems)))
        return replace(outcome, failure=failure), written

    def _say(self, outcome: _Outcome, written: Written) -> None:
        calibration = outcome.calibration
        if self.quiet:
            return
        for warning in calibration.warnings:
            say(styled("WARNING", fg="red", bold=True), f": {warning}", err=True)
        if calibration.warnings:
            remedy = calibration.verdicts["exposures"].remedy
            say(f"  response and vignette are marginal at best; {remedy}", err=True)
        if self.as_json:
            return
        say_notes((*calibration.notes, *self._saving_notes))
        say_notes(outcome.skipping, "warning")
        say_result(calibration, self.folder, written, self.truth, outcome.basis(len(self.recording)))

    def _as_dict(self, outcome: _Outcome, written: Written) -> dict[str, Any]:
        calibration = outcome.calibration
        return {
            "exit_code": outcome.exit_code,
            **result_as_dict(calibration, self.folder, written, self.truth),
            "interrupted": outcome.interrupted,
            "error": outcome.failure or None,
            "skipped": list(outcome.skipped),
            "exposure_lag_frames": calibration.source.get("exposure_lag_frames"),
            "exposure_lag_corrected_frames": calibration.source.get("exposure_lag_corrected_frames", 0),
            "notes": [*self.recording.notes, *calibration.notes, *self._saving_notes, *written.notes],
        }

    @property
    def _saving_notes(self) -> list[str]:
        return [] if self.checkpoints is None else self.checkpoints.notes


@dataclass(frozen=True)
class _Outcome:
    """A calibration, marked partial if the run did not come to its end.

    ``skipped`` has the first reasons for skipped frames, ``failure`` what went wrong; it is empty if nothing did.
    """

    calibration: Calibration
    skipped: tuple[str, ...]
    interrupted: bool
    failure: str

    @property
    def exit_code(self) -> int:
        if self.failure:
            return FAILED
        if self.interrupted:
            return INTERRUPTED
        return COMPLETE if self.calibration.complete else UNDETERMINED

    @property
    def skipping(self) -> Iterator[str]:
        """What to note on skipped frames: how many there were, and why the first few were."""
        counts = self.calibration.counts
        if counts.get("skipped"):
            more = "; …" if counts["skipped"] > len(self.skipped) else ""
            yield f"{counts['skipped']} of {counts['frames']} frames skipped: {'; '.join(self.skipped)}{more}"

    def basis(self, total_frames: int) -> Iterator[str]:
        """Return what the calibration rests on, as lines."""
        counts, partial = self.calibration.counts, self.calibration.partial
        seen = f"{counts['frames']} of {total_frames} frames" if partial else f"{counts['frames']} frames"
        yield f"from {seen}, {counts.get('pairs', 0)} pairs, {counts.get('samples', 0)} samples"
        if self.interrupted:
            yield "partial: the run was interrupted; more frames would tell more"
        elif partial:
            yield "partial: the run failed before its end"


def _load_drawing() -> None:
    """Load the modules that draw while frames are compared, for which two cores are not needed all the time."""
    from ospc.report import style

    style.load()


def _estimate(calibrator: OnlineCalibrator, failure: str, *, early: bool) -> Calibration:
    """Return the estimate from the frames pushed so far."""
    try:
        return calibrator.calibration()
    except Exception as error:
        if early:
            raise KeyboardInterrupt(one_line(error)) from error
        raise OspcError(failure or one_line(error)) from error


def _identity(recording: Recording) -> dict[str, object]:
    from ospc.recording import identity

    try:
        return identity(recording)
    except Exception as error:  # the calibration is worth more than knowing what it was made of
        return {"kind": recording.kind, "name": recording.path.name, "problem": one_line(error)}
