"""All output to standard output and standard error, including progress, with escape sequences made harmless.

Names of folders, topics and cameras, and texts in files, are untrusted and may contain terminal escape sequences.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.interruption import Interruption
from ospc.errors import OspcError, escaped
from ospc.formats.files import json_text

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment


COMPLETE, FAILED, UNDETERMINED, INTERRUPTED = 0, 1, 3, 130
"""Exit codes: everything is identifiable without warnings; an error; something is not identifiable, or there is a
warning; and 128 + SIGINT after Ctrl-C, as shells expect."""

EXITS = {
    COMPLETE: "complete: response and vignette are identifiable, and the exposures agree with the images",
    FAILED: "error; a partial result is written if possible",
    UNDETERMINED: "written, but response, vignette or exposures are marginal or not identifiable, or the camera "
    "changed while it filmed",
    INTERRUPTED: "interrupted; the result so far is written and marked partial",
}
"""What the exit codes of commands that calibrate a camera mean."""


class Styled(str):
    """A text that may contain escape sequences; make one with :func:`styled`."""

    __slots__ = ()


def styled(text: str, **style: Any) -> Styled:
    """Return an escaped text in a style of :func:`click.style`."""
    return Styled(click.style(escaped(text), **style))


def say(*parts: str, err: bool = False) -> None:
    """Print one line, on standard error if ``err``; parts are escaped unless they are :class:`Styled`."""
    click.echo("".join(part if isinstance(part, Styled) else escaped(part) for part in parts), err=err)


def say_notes(notes: Iterable[str], label: str = "note") -> None:
    """Print notes on standard error, one per line."""
    for note in notes:
        say(f"{label}: {note}", err=True)


def spreads_in_words(response_sigma: float | None, vignette_sigma: float | None) -> list[str]:
    """Return the standard deviations of response and vignette that are known."""
    sigmas = {"g": response_sigma, "V": vignette_sigma}
    return [f"{name} ±{sigma:.2g}" for name, sigma in sigmas.items() if sigma is not None]


def say_table(
    headings: Iterable[str], rows: Iterable[Iterable[Any]], *, right: str | None = None, columns_when_piped: int
) -> None:
    """Print a table of rich texts; the column with the heading ``right`` is right-aligned."""
    from rich.table import Table

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for heading in headings:
        table.add_column(heading, overflow="fold", justify="right" if heading == right else "left")
    for row in rows:
        table.add_row(*row)
    console(width=None if sys.stdout.isatty() else columns_when_piped).print(table)


def print_json(content: Any) -> None:
    """Print one JSON document on standard output; non-finite numbers become null."""
    for line in json_text(content).split("\n"):
        say(line.replace("\x7f", "\\u007f"))  # the only control character that JSON does not escape


def concluded(content: dict[str, Any], *, as_json: bool) -> int:
    """Print a result as JSON if ``as_json``, and return its exit code; OspcError if the run failed."""
    if as_json:
        print_json(content)
    if content["error"]:
        raise OspcError(content["error"])
    return int(content["exit_code"])


def console(**options: Any) -> Console:
    """Return a rich console for tables and progress that escapes text like :func:`say`."""
    from rich.console import Console
    from rich.segment import Segment

    class SafeConsole(Console):
        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                yield segment if segment.control else Segment(escaped_lines(segment.text), segment.style)

    return SafeConsole(highlight=False, **options)


def escaped_lines(text: str) -> str:
    """Return a text with everything escaped that a terminal would interpret, except line breaks."""
    return "\n".join(escaped(line.expandtabs(4)) for line in text.split("\n"))


class ProgressLine:
    """A progress bar with the stage, the number of steps, further figures, and the remaining time."""

    def __init__(self, on: Console | None = None) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self.bar = Progress(
            TextColumn("{task.description:10}", markup=False),
            BarColumn(bar_width=24),
            TextColumn("{task.fields[count]}"),
            TextColumn("{task.fields[figures]}", markup=False),
            TimeRemainingColumn(compact=True),
            console=on or console(stderr=True),
            transient=True,
        )
        self._task = self.bar.add_task("", total=None, figures="", count="")
        self._done = 0.0

    def show(self, stage: str, done: float, total: float, figures: str = "") -> None:
        """Show the progress of a stage; the clock restarts when ``done`` decreases.

        With a total of 0, the progress is unknown, and the bar moves back and forth.
        """
        if done < self._done:
            self.bar.reset(self._task)
        self._done = done
        self.bar.tasks[self._task].total = total or None
        count = f"{done:.0f}/{total:.0f}" if total else ""
        self.bar.update(self._task, description=stage, completed=done, figures=figures, count=count)


@contextmanager
def progress_line(*, quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Yield the function :meth:`ProgressLine.show`, or one that does nothing outside a terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda *_shown, **_more: None
        return
    line = ProgressLine()
    with line.bar:
        yield line.show


@contextmanager
def progress_of(
    stage: str, *, quiet: bool = False, interruption: Interruption | None = None
) -> Iterator[Callable[[int, int], None]]:
    """Yield a function to call with the number of steps done and in total; after the last, the stage is "finishing".

    Signals are deferred to the end of a step, which then raises ``KeyboardInterrupt``.
    """
    with progress_line(quiet=quiet) as show:

        def step(done: int, total: int) -> None:
            if interruption is not None:
                interruption.check()
            if done < total:
                show(stage, done, total)
            else:
                show("finishing", 0, 0)

        with nullcontext() if interruption is None else interruption.deferred():
            yield step
