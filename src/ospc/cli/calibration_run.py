"""One calibration as commands run it: visible, interruptible, and never in vain."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Thread
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.calibration_report import as_json, say_errors, say_notes, say_result, say_skipped
from ospc.cli.exposure_options import say_exposures
from ospc.cli.interruption import Interruption
from ospc.cli.live import NOT_WATCHED, Watcher, Watching
from ospc.errors import OspcError, said_by

if TYPE_CHECKING:
    from ospc.calibrator import OnlineCalibrator
    from ospc.cli.checkpoints import Checkpoints
    from ospc.evaluation.comparison import Comparison
    from ospc.exposures.findings import LagChoice
    from ospc.formats.opening import Photometry
    from ospc.output import OutputFolder, Written
    from ospc.photometry.calibration import Calibration
    from ospc.recording import Frame, Recording
    from ospc.settings import Settings


@dataclass(frozen=True)
class Outcome:
    """What came of a run.

    Attributes
    ----------
    calibration
        What is known; marked partial if the run did not come to its end.
    skipped
        Why frames were skipped, the first few.
    interrupted
        Whether the user stopped it.
    failure
        What went wrong, as one sentence; empty if nothing did.
    """

    calibration: Calibration
    skipped: tuple[str, ...] = ()
    interrupted: bool = False
    failure: str = ""


def print_json(content: dict[str, Any]) -> None:
    """Print one JSON document on standard output."""
    click.echo(json.dumps(content, indent=1))


@dataclass(frozen=True)
class Options:
    """How a run is reported.

    Attributes
    ----------
    quiet
        Say nothing but errors.
    as_json
        Print one JSON document instead of text.
    truth
        What to compare with.
    checkpoints
        Where states are saved, and whether to go on from one; None for nowhere.
    pdf
        Whether to write the report as PDF too.
    tell
        Takes the JSON document.
    watching
        How the run is watched, where somebody looks at a terminal.
    correct_lag
        What to do about a lag of the exposures.
    """

    quiet: bool = False
    as_json: bool = False
    truth: Photometry | None = None
    checkpoints: Checkpoints | None = None
    pdf: bool = False
    tell: Callable[[dict[str, Any]], None] = print_json
    watching: Watching = NOT_WATCHED
    correct_lag: LagChoice = "auto"


COMPLETE, FAILED, UNDETERMINED, INTERRUPTED = 0, 1, 3, 130
"""Exit codes; 2 is wrong usage."""


def calibrate_into(
    folder: OutputFolder, recording: Recording, settings: Settings, interruption: Interruption, options: Options
) -> int:
    """Calibrate, write the folder, report, and return the exit code.

    Raises
    ------
    OspcError
        If something failed; what was known by then has been written and reported.
    KeyboardInterrupt
        If the user gave up before anything was written.
    """
    from ospc.output import Written

    talkative = not options.quiet and not options.as_json
    if talkative:
        say_notes(recording.notes)
    watching = replace(options.watching, visible=not options.quiet and sys.stderr.isatty())
    Thread(target=_load_drawing, daemon=True).start()
    with interruption.deferred():
        outcome = run(
            recording,
            settings,
            interruption,
            watching=watching,
            announce=not options.quiet,
            checkpoints=options.checkpoints,
            correct_lag=options.correct_lag,
        )
        with interruption.held():
            outcome, written = _write(folder, recording, outcome, interruption, options)
            if options.checkpoints is not None and options.checkpoints.saved:
                written += Written((options.checkpoints.place,))
            code = _exit_code(outcome)
            _report(outcome, recording, folder, written, options)
    if outcome.failure:
        raise OspcError(outcome.failure)
    return code


def _load_drawing() -> None:
    """Load the modules that draw while frames are compared, for which two cores are not needed all the time."""
    from ospc.report import style

    style.load()


def _exit_code(outcome: Outcome) -> int:
    if outcome.failure:
        return FAILED
    if outcome.interrupted:
        return INTERRUPTED
    return COMPLETE if outcome.calibration.complete and not outcome.calibration.warnings else UNDETERMINED


def _report(outcome: Outcome, recording: Recording, folder: OutputFolder, written: Written, options: Options) -> None:
    if not options.quiet:
        say_exposures(outcome.calibration)
    comparison = _compare(outcome, options.truth)
    saving = [] if options.checkpoints is None else options.checkpoints.notes
    if options.as_json:
        content = {"exit_code": _exit_code(outcome), **as_json(outcome, folder, written, comparison)}
        content["notes"] = [*recording.notes, *outcome.calibration.notes, *saving, *written.notes]
        options.tell(content)
    elif not options.quiet:
        say_notes((*outcome.calibration.notes, *saving))
        say_skipped(outcome)
        say_result(outcome, len(recording), folder, written)
        say_notes(written.notes)
        if options.truth is not None:
            say_errors(comparison, outcome.calibration, options.truth.name)


def _write(
    folder: OutputFolder,
    recording: Recording,
    outcome: Outcome,
    interruption: Interruption,
    options: Options,
) -> tuple[Outcome, Written]:
    """Write data, report, then pictures; an interruption now only leaves out pictures."""
    before = interruption.count
    written = folder.write(outcome.calibration, recording)
    if not written.problems:
        with ThreadPoolExecutor(1) as second:
            # The report follows points through images, which leaves the interpreter to whoever draws.
            reported = second.submit(folder.report, outcome.calibration, recording, options.truth, pdf=options.pdf)
            if options.pdf:
                reported.result()  # drawn as the pictures are, which is not to be done twice at once
            drawn = folder.draw(outcome.calibration, options.truth, stop=lambda: interruption.count > before)
            written += reported.result() + drawn
    if interruption.requested and not outcome.interrupted:
        unfinished = replace(outcome.calibration, partial=True)
        unfinished.save(folder.path / "calibration.json")
        outcome = replace(outcome, calibration=unfinished, interrupted=True)
    failure = "; ".join(filter(None, (outcome.failure, *written.problems)))
    return replace(outcome, failure=failure), written


def _compare(outcome: Outcome, truth: Photometry | None) -> Comparison | None:
    """Return the errors against a truth; None where the two have nothing in common."""
    from ospc.evaluation.comparison import compare
    from ospc.formats.opening import Photometry

    calibration = outcome.calibration
    estimate = Photometry("estimate", calibration.response, calibration.vignette, calibration)
    responses = truth is not None and truth.response is not None and estimate.response is not None
    vignettes = truth is not None and truth.vignette is not None and estimate.vignette is not None
    return compare(estimate, truth) if truth is not None and (responses or vignettes) else None


def run(
    recording: Recording,
    settings: Settings,
    interruption: Interruption,
    *,
    watching: Watching,
    announce: bool = True,
    checkpoints: Checkpoints | None = None,
    correct_lag: LagChoice = "auto",
) -> Outcome:
    """Calibrate; what was seen before an interruption or a failure is not lost.

    Parameters
    ----------
    recording
        The recording.
    settings
        Settings of the method.
    interruption
        Tells when to stop.
    watching
        How it is watched.
    announce
        Whether to say on standard error that an interruption was understood.
    checkpoints
        Where states are saved, and whether to go on from one; None for nowhere.
    correct_lag
        What to do about a lag of the exposures.

    Raises
    ------
    OspcError
        If nothing at all could be estimated.
    KeyboardInterrupt
        If the user does not want to wait for the estimate from the frames seen so far either, or they allow none.
    """
    from ospc.calibrator import OnlineCalibrator
    from ospc.unknown_exposures import labelled

    with watching.of(recording) as show, interruption.deferred():
        source = _identity(recording)
        calibrator = OnlineCalibrator(settings, correct_lag=correct_lag)
        calibrator.source = source
        if checkpoints is not None:
            calibrator = checkpoints.resumed(calibrator)
        failure = _push_all(recording, calibrator, interruption, show, checkpoints)
        early = interruption.requested
        show(calibrator, "estimating")
        if early and announce:
            frames = calibrator.status.frames
            click.echo(f"interrupted: estimating from {frames} frames; Ctrl-C again gives up", err=True)
        calibration = labelled(_estimate(calibrator, failure, early=early), recording)
        if checkpoints is not None:
            checkpoints.at_the_end(calibrator)
    stopped = interruption.requested
    return Outcome(replace(calibration, partial=stopped or bool(failure)), calibrator.first_reasons, stopped, failure)


def sentence(error: BaseException) -> str:
    """Return what an exception says on one line; one that nobody expected with its kind."""
    text = said_by(error)
    return text if isinstance(error, OspcError) else f"unexpected {type(error).__name__}: {text}".rstrip(": ")


def _push_all(
    recording: Recording,
    calibrator: OnlineCalibrator,
    interruption: Interruption,
    show: Watcher,
    checkpoints: Checkpoints | None,
) -> str:
    """Push frames until their end or an interruption, and return what went wrong."""
    from ospc.calibrator import drive

    def after(frame: Frame, used: bool) -> None:
        show(calibrator, "comparing", frame if used else None)
        if checkpoints is not None:
            checkpoints.after_frame(calibrator)
        if interruption.requested:
            raise KeyboardInterrupt

    try:
        drive(calibrator, recording, after)
    except KeyboardInterrupt:
        pass  # what there is will be estimated
    except Exception as error:  # whatever it is, the frames before it are worth an estimate
        return sentence(error)
    return ""


def _estimate(calibrator: OnlineCalibrator, failure: str, *, early: bool) -> Calibration:
    """Return the estimate from the frames pushed so far."""
    try:
        return calibrator.calibration()
    except Exception as error:
        if early:
            raise KeyboardInterrupt(sentence(error)) from error
        raise OspcError(failure or sentence(error)) from error


def _identity(recording: Recording) -> dict[str, object]:
    from ospc.recording import identity

    try:
        return identity(recording)
    except Exception as error:  # the calibration is worth more than knowing what it was made of
        return {"kind": recording.kind, "name": recording.path.name, "problem": sentence(error)}
