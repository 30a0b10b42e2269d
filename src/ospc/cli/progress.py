"""How far the work is, in one line on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ospc.cli.interruption import Interruption
from ospc.cli.terminal import console

if TYPE_CHECKING:
    from rich.console import Console


class ProgressLine:
    """A stage, a bar, how many steps of how many are done, further figures, and the time left.

    Parameters
    ----------
    on
        Where to show it; standard error if None.
    """

    def __init__(self, on: Console | None = None) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self.bar = Progress(
            TextColumn("{task.description:10}", markup=False),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("{task.fields[figures]}", markup=False),
            TimeRemainingColumn(compact=True),
            console=on or console(stderr=True),
            transient=True,
        )
        self._task = self.bar.add_task("", total=None, figures="")
        self._done = 0.0

    def show(self, stage: str, done: float, total: float, figures: str = "") -> None:
        """Show a stage; one of which less is done than before starts the clock anew."""
        if done < self._done:
            self.bar.reset(self._task, total=total)
        self._done = done
        self.bar.update(self._task, description=stage, completed=done, total=total or None, figures=figures)


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
    """Give a function to call with the number of steps done and of all.

    Parameters
    ----------
    stage
        What is being done, in one word.
    quiet
        Whether to show nothing.
    interruption
        Its signals are deferred to the end of a step, which then raises ``KeyboardInterrupt``.
    """
    with progress_line(quiet=quiet) as show:
        if interruption is None:
            yield lambda done, total: show(stage, done, total)
            return

        def step(done: int, total: int) -> None:
            interruption.check()
            show(stage, done, total)

        with interruption.deferred():
            yield step
