"""How far the work is: one line on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from ospc.cli.interruption import Interruption
from ospc.cli.terminal import console

if TYPE_CHECKING:
    from rich.console import Console


class ProgressLine:
    """A stage, a bar, how many steps of how many are done, further figures, and the time left."""

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
        """Show a stage; one of which less is done than before starts the clock anew.

        With a total of 0, nobody knows how far it is: the bar moves to and fro instead of standing still.
        """
        if done < self._done:
            self.bar.reset(self._task)
        self._done = done
        self.bar.tasks[self._task].total = total or None
        count = f"{done:.0f}/{total:.0f}" if total else ""
        self.bar.update(self._task, description=stage, completed=done, figures=figures, count=count)


@contextmanager
def progress_line(*, quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Give the function :meth:`ProgressLine.show`; where nobody looks at a terminal, one that does nothing."""
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
    """Give a function to call with the number of steps done and of all; what follows the last is "finishing".

    Signals of an ``interruption`` are deferred to the end of a step, which then raises ``KeyboardInterrupt``.
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
