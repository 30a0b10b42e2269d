"""``ospc live``: a guided capture, shown in a browser or in the terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from ospc.cli.interruption import Interruption, leaving
from ospc.cli.options import AS_JSON, CORRECT_LAG, FORCE, QUIET, argument, declared, option, out_option
from ospc.cli.reading import READING, Reading
from ospc.cli.terminal import EXITS, concluded, say, say_notes, spreads_in_words
from ospc.errors import OspcError, counted, one_line
from ospc.recording import Frame, Recording, identity
from ospc.settings.live import GOAL

if TYPE_CHECKING:
    from ospc.cli.calibration_result import ResultFolder
    from ospc.exposures.lag_choice import LagChoice
    from ospc.live.capture import Capture

_LINE_S = 5.0
"""Time between two lines in the terminal, if the instruction stays the same, in seconds."""


@declared("live", exits=EXITS)
def command(
    interruption: Interruption,
    *,
    source: str = argument(),
    out: Path = out_option("Folder to write the results to."),
    no_page: bool = option("Print the instructions in the terminal, without a page in the browser."),
    port: int = option(
        "Port of the page; by default any free port.", type=click.IntRange(0, 65535), default=0, show_default=False
    ),
    no_browser: bool = option("Print the address of the page without opening a browser."),
    goal: float = option(
        "Uncertainty of response and vignette at which the capture ends on its own; 0 to end it yourself.",
        type=click.FloatRange(min=0),
        default=GOAL,
    ),
    pace: float = option(
        "Speed factor for replaying a recording; 0 for as fast as it can be calibrated.",
        type=click.FloatRange(min=0),
        default=1.0,
    ),
    correct_lag: LagChoice = CORRECT_LAG,
    force: bool = FORCE,
    quiet: bool = QUIET,
    as_json: bool = AS_JSON,
    reading: Reading = READING,
) -> int:
    """Calibrate the camera SOURCE while it films, with advice on what to film next.

    SOURCE is a camera as for 'ospc record' (opencv:0, realsense, depthai:left, …), or a recording, which is replayed
    as if it were being filmed.

    A page in the browser (extra 'live') shows the picture, the coverage so far, the uncertainty of response and
    vignette, and one instruction at a time. It can be reached from this machine only. The terminal shows the
    instructions as lines of text.

    The capture ends when both are known to within the goal, with the button on the page, Ctrl-C or SIGTERM, when the
    terminal is closed, or at the end of a recording. OUT then gets the files that 'ospc calibrate' writes.
    """
    from ospc.cli.calibration_result import ResultFolder
    from ospc.exposures.lag_choice import lag_choice_for
    from ospc.live.calibrator import LiveCalibrator
    from ospc.live.capture import Capture
    from ospc.report.output_folder import OutputFolder

    if no_page and (port or no_browser):
        raise click.UsageError("--port and --no-browser apply to the page; leave out --no-page")
    with leaving("no result was written"), ExitStack() as stack:
        film = stack.enter_context(_opened(source, reading, pace))
        recording = film.recording
        folder = OutputFolder.at(out, recording=None if recording is None else Path(source), force=force)
        if not (quiet or as_json):
            say_notes(film.notes)
        aim = goal or GOAL
        if recording is not None:
            correct_lag = lag_choice_for(recording, correct_lag)
        live = stack.enter_context(LiveCalibrator(correct_lag=correct_lag, goal=aim, source=film.about))
        capture = Capture(live, ends=goal > 0, out=str(out))
        if not no_page:
            _show_page(stack, capture, port, browser=not no_browser)
        try:
            result = ResultFolder(folder, interruption, quiet, as_json, times=capture)
            content = _captured(capture, recording, film.frames, result)
        except OspcError as error:
            capture.stage, capture.message = "failed", str(error)
            raise
        if content["error"]:
            capture.stage, capture.message = "failed", content["error"]
        else:
            capture.stage, capture.message = "written", f"Written to {out}. This page can be closed."
    return concluded(content, as_json=as_json)


class _Film(NamedTuple):
    """Frames with their identification and notes; the recording is None for those of a camera."""

    recording: Recording | None
    frames: Iterable[Frame]
    about: dict[str, Any]
    notes: Iterable[str]


@contextmanager
def _opened(source: str, reading: Reading, pace: float) -> Iterator[_Film]:
    """Open the recording of that name, otherwise a camera."""
    from ospc.live.capture import replayed
    from ospc.recording.live import open_camera

    place = Path(source)
    if place.exists():
        recording = reading.open(place)
        yield _Film(recording, replayed(recording, pace), identity(recording), recording.notes)
        return
    if reading.mask is not None or reading.region is not None or reading.each_channel or reading.kind is not None:
        raise click.UsageError("--kind, --mask, --roi and --channel each apply to recordings only, not to cameras")
    if place.name != source:
        raise OspcError(f"{source}: does not exist; give a recording, or a camera such as opencv:0")
    with open_camera(source, reading.options) as camera:
        yield _Film(None, camera, {"kind": "camera", "name": camera.name}, camera.notes)


def _show_page(stack: ExitStack, capture: Capture, port: int, *, browser: bool) -> None:
    from ospc.live.page.server import PageServer

    server = stack.enter_context(PageServer(capture, port))
    say(f"guidance at {server.url} (this machine only); end the capture with Ctrl-C or the button there", err=True)
    if browser:
        click.launch(server.url)


def _captured(
    capture: Capture, recording: Recording | None, frames: Iterable[Frame], result: ResultFolder
) -> dict[str, Any]:
    """Film, estimate, write and report."""
    from ospc.cli.calibration_result import CalibrationOutcome
    from ospc.report import style

    live, interruption, failure, replayed = capture.live, result.interruption, "", recording is not None
    with interruption.deferred():
        show = _instructions(capture) if result.prints_text else lambda: None

        def stop() -> bool:
            show()
            return interruption.requested

        try:
            capture.run(interruption.until_requested(frames), stop, replayed=replayed)
        except Exception as error:  # estimate from the frames before the error
            failure = one_line(error)
        capture.stage = "estimating"
        result.second.submit(style.load)  # not earlier: a small computer needs the memory while it films
        try:
            found = live.calibration()
        except OspcError as error:
            raise OspcError(failure or str(error)) from None
        capture.stage = "writing"
        # A camera's capture is complete whenever the user ends it; an interrupted recording is not.
        early = interruption.requested and replayed
        found = replace(found, partial=early or bool(failure))
        *ended, _ = live.status.epochs
        outcome = CalibrationOutcome(found, recording, live.first_reasons, early, failure, tuple(ended))
        return result.take(outcome, live.save_state, () if replayed else live.status.notes)


def _instructions(capture: Capture) -> Callable[[], None]:
    """Return a function that prints a line for every new instruction and every few seconds."""
    text, next_s = "", 0.0

    def show() -> None:
        nonlocal text, next_s
        status, now_s = capture.live.status, time.monotonic()
        if status.advice == text and now_s < next_s:
            return
        text, next_s = status.advice, now_s + _LINE_S
        parts = [counted(status.frames, "frame"), counted(status.progress.pairs, "pair")]
        parts += [f"{status.dropped} dropped"] if status.dropped else []
        parts += spreads_in_words(status.instruction.response_sigma, status.instruction.vignette_sigma)
        parts += [f"{name} {share:.0%}" for name, share in asdict(capture.bars).items()]
        say("  ".join(parts), err=True)
        say(f"  → {text}", err=True)

    return show
