"""How far the work is: one line on standard error, and the Rerun viewer where it is asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ospc.cli.interruption import Interruption
from ospc.cli.terminal import console
from ospc.errors import counted

if TYPE_CHECKING:
    from rich.console import Console

    from ospc.calibrator import OnlineCalibrator, Status
    from ospc.recording import Frame, Recording


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


Watcher = Callable[["OnlineCalibrator", str, "Frame | None"], None]
"""Called with the calibrator, the stage in one word, and the frame just used; None if none was."""

COMPARING = "comparing"
"""The stage of which it is known how far it is."""


@dataclass(frozen=True)
class Watching:
    """How a run is watched: on a terminal, in the Rerun viewer, by a file for that viewer."""

    visible: bool = False
    viewer: bool = False
    stream: Path | None = None

    @contextmanager
    def of(self, recording: Recording) -> Iterator[Watcher]:
        """Yield the function to call after every frame."""
        with ExitStack() as stack:
            watchers: list[Watcher] = []
            if self.viewer or self.stream is not None:
                from ospc.cli.rerun_stream import RerunStream

                watchers.append(stack.enter_context(RerunStream.opened(recording, self.stream, spawn=self.viewer)))
            if self.visible:
                watchers.append(stack.enter_context(_bar_shown(len(recording))))

            def tell(calibrator: OnlineCalibrator, stage: str, frame: Frame | None) -> None:
                for watcher in watchers:
                    watcher(calibrator, stage, frame)

            yield tell


@contextmanager
def _bar_shown(total: int) -> Iterator[Watcher]:
    with progress_line() as show:

        def watch(calibrator: OnlineCalibrator, stage: str, _frame: Frame | None) -> None:
            status = calibrator.status
            done, of = (status.frames, total) if stage == COMPARING else (0, 0)
            show(stage, done, of, figures(status))

        yield watch


def figures(status: Status) -> str:
    """Return the method's own figures in one line."""
    progress = status.progress
    parts = [counted(progress.pairs, "pair")]
    if progress.response_sigma is not None:
        parts.append(f"g ±{progress.response_sigma:.2g}")
    if progress.vignette_sigma is not None:
        parts.append(f"V ±{progress.vignette_sigma:.2g}")
    return "  ".join(parts)
