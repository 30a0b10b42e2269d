"""What is shown while a calibration runs: a progress bar, and the Rerun viewer where it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ospc.cli.progress import progress_line
from ospc.errors import counted

if TYPE_CHECKING:
    from ospc.calibrator import OnlineCalibrator, Status
    from ospc.recording import Frame, Recording

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
