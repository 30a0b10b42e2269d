"""What is shown while a calibration runs: a progress bar, or coverage and converging curves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ospc.arrays import FloatArray
from ospc.cli.pace import Pace
from ospc.cli.progress import ProgressLine, progress_line
from ospc.cli.terminal import console

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from ospc.calibrator import OnlineCalibrator, Status
    from ospc.methods.preview import Preview
    from ospc.recording import Frame, Recording

Watcher = Callable[["OnlineCalibrator", str, "Frame | None"], None]
"""Is told where a run stands: the calibrator, the stage in one word, and the frame just used, None where none was."""

COMPARING = "comparing"
"""The stage of which it is known how far it is."""

_REFRESH_S = 0.4
"""Shortest time between two pictures, in seconds."""

_LARGEST_SHARE = 0.03
"""Largest share of the time that watching may take."""

_EARLIER_CURVES = 5
_MOST_COLUMNS, _ROWS = 42, 9
"""Size of a drawing in characters."""


@dataclass(frozen=True)
class Watching:
    """How a run is watched.

    Attributes
    ----------
    visible
        Whether somebody looks at a terminal.
    live
        Whether to show coverage and curves there, instead of a progress bar alone.
    viewer
        Whether to open the Rerun viewer.
    stream
        File to stream to, for that viewer; None for none.
    """

    visible: bool = False
    live: bool = False
    viewer: bool = False
    stream: Path | None = None

    @contextmanager
    def of(self, recording: Recording) -> Iterator[Watcher]:
        """Give what is to be told of every frame.

        Raises
        ------
        MissingExtraError
            If the Rerun viewer is asked for, but not installed.
        FormatError
            If the file cannot be written.
        """
        with ExitStack() as stack:
            watchers: list[Watcher] = []
            if self.viewer or self.stream is not None:
                from ospc.cli.live_rerun import RerunStream

                watchers.append(stack.enter_context(RerunStream.opened(recording, self.stream, spawn=self.viewer)))
            if self.visible:
                show = LiveView(len(recording)).shown if self.live else partial(_bar_shown, len(recording))
                watchers.append(stack.enter_context(show()))

            def tell(calibrator: OnlineCalibrator, stage: str, frame: Frame | None) -> None:
                for watcher in watchers:
                    watcher(calibrator, stage, frame)

            yield tell


@contextmanager
def _bar_shown(total: int) -> Iterator[Watcher]:
    with progress_line() as show:
        yield lambda calibrator, stage, _frame: _show_status(show, calibrator, stage, total)


def _show_status(show: Callable[..., None], calibrator: OnlineCalibrator, stage: str, total: int) -> None:
    status = calibrator.status
    done, of = (status.frames, total) if stage == COMPARING else (0, 0)
    show(stage, done, of, figures(status))


@dataclass
class LiveView:
    """Coverage and converging curves on standard error, some times a second.

    Attributes
    ----------
    total
        Number of frames.
    console
        Where to; standard error where not given.
    """

    total: int
    console: Console | None = None
    _pace: Pace = field(default_factory=partial(Pace, _REFRESH_S, _LARGEST_SHARE))
    _responses: list[FloatArray] = field(default_factory=list)
    _vignettes: list[FloatArray] = field(default_factory=list)
    _spreads: tuple[list[float], list[float]] = field(default_factory=lambda: ([], []))

    @contextmanager
    def shown(self) -> Iterator[Watcher]:
        """Show it for the time of the context."""
        from rich.live import Live

        on = self.console or console(stderr=True)
        line = ProgressLine(on)
        with Live(line.bar, console=on, transient=True, auto_refresh=False) as live:

            def show(calibrator: OnlineCalibrator, stage: str, _frame: Frame | None) -> None:
                if self._pace.due or stage != COMPARING:
                    with self._pace.look():
                        _show_status(line.show, calibrator, stage, self.total)
                        live.update(self.picture(line.bar, calibrator.preview(), on.width), refresh=True)

            yield show

    def picture(self, head: RenderableType, preview: Preview | None, width: int) -> RenderableType:
        """Return what to show of a preview below a head line, so many characters wide, and remember its curves."""
        from rich.console import Group
        from rich.text import Text

        if preview is None:
            return Group(head, Text("nothing was compared yet", style="dim"))
        self._remember(preview)
        return Group(head, _coverage(preview), self._curves(width))

    def _remember(self, preview: Preview) -> None:
        from ospc.photometry.calibration import PROFILE_RADII
        from ospc.photometry.vignette import diagonal_profile

        if preview.response is None or preview.vignette is None or preview.vignette_sigma is None:
            return
        response = preview.response.inverse(np.linspace(0, 1, 101))
        if self._responses and np.array_equal(response, self._responses[-1]):
            return
        spread = preview.response.inverse_sigma
        self._responses.append(response)
        self._vignettes.append(diagonal_profile(preview.vignette, PROFILE_RADII))
        self._spreads[0].append(float(np.nan if spread is None else spread.max()))
        self._spreads[1].append(float(preview.vignette_sigma[-1]))

    def _curves(self, width: int) -> RenderableType:
        from rich.table import Table

        from ospc.cli.live_marks import Canvas, falling

        columns = max(8, min(_MOST_COLUMNS, width // 2 - 3))
        table = Table(box=None, padding=(0, 2, 0, 0))
        names = ("response g(M)", "vignette V(R)")
        drawings, captions = [], []
        for name, curves, spreads, colour in zip(
            names, (self._responses, self._vignettes), self._spreads, ("bright_blue", "bright_yellow"), strict=True
        ):
            table.add_column(name, header_style="bold", width=columns, no_wrap=True)
            canvas = Canvas(columns, _ROWS)
            for curve in curves[-1 - _EARLIER_CURVES : -1]:
                canvas.line(curve, "bright_black")
            for curve in curves[-1:]:
                canvas.line(curve, colour)
            drawings.append(canvas.text())
            captions.append(f"±{spreads[-1]:.2g}  {falling(spreads, columns - 10)}" if spreads else "no estimate yet")
        table.add_row(*drawings)
        table.add_row(*captions)
        return table


def figures(status: Status) -> str:
    """Return the method's own figures in one line."""
    progress = status.progress
    parts = [f"{progress.pairs} pairs"]
    if progress.response_sigma is not None:
        parts.append(f"g ±{progress.response_sigma:.2g}")
    if progress.vignette_sigma is not None:
        parts.append(f"V ±{progress.vignette_sigma:.2g}")
    return "  ".join(parts)


def _coverage(preview: Preview) -> RenderableType:
    from rich.table import Table

    from ospc.cli.live_marks import bars

    seen = preview.coverage
    low, high = seen.exposure_edges_ms[[0, -1]]
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_row("grey levels", f"[green]{bars(seen.by_grey)}[/]", "black to white")
    table.add_row("exposures", f"[green]{bars(seen.grey_exposure.sum(axis=1))}[/]", f"{low:.3g} to {high:.3g} ms")
    table.add_row("radii", f"[green]{bars(seen.by_radius)}[/]", "centre to corner; · is never seen")
    return table
