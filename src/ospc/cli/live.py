"""What is shown while a calibration runs: a progress bar, or coverage and converging curves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ospc.arrays import FloatArray

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from ospc.calibrator import OnlineCalibrator, Status
    from ospc.methods.preview import Preview
    from ospc.recording import Frame, Recording

_REFRESH_S = 0.4
_LARGEST_SHARE = 0.03
_EARLIER_CURVES = 5
_MOST_COLUMNS, _ROWS = 42, 9
_RADII = 51


class Watcher(Protocol):
    """Is told of every frame that was pushed."""

    def __call__(self, calibrator: OnlineCalibrator, stage: str, frame: Frame | None = None) -> None:
        """Take note of where a run stands.

        Parameters
        ----------
        calibrator
            The run.
        stage
            What it does now, in one word.
        frame
            The frame just pushed; None where none was.
        """
        ...


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
                view = LiveView(len(recording)) if self.live else ProgressBar(len(recording))
                watchers.append(stack.enter_context(view.shown()))

            def tell(calibrator: OnlineCalibrator, stage: str, frame: Frame | None = None) -> None:
                for watcher in watchers:
                    watcher(calibrator, stage, frame)

            yield tell


NOT_WATCHED = Watching()
"""Nobody looks."""


class Pace:
    """Says when to look again: not too often, and so that looking takes a small share of the time.

    Parameters
    ----------
    least_s
        Shortest time between looks.
    share
        Largest share of all time that looking may take.
    """

    def __init__(self, least_s: float = _REFRESH_S, share: float = _LARGEST_SHARE) -> None:
        self._least_s, self._share = least_s, share
        self._next_s = -float("inf")

    @property
    def due(self) -> bool:
        """Whether it is time."""
        return time.monotonic() >= self._next_s

    @contextmanager
    def look(self) -> Iterator[None]:
        """Measure how long a look takes."""
        begun_s = time.monotonic()
        yield
        now_s = time.monotonic()
        self._next_s = now_s + max(self._least_s, (now_s - begun_s) / self._share)


class ProgressBar:
    """Frames done, and the method's own figures, in one line on standard error.

    Parameters
    ----------
    total
        Number of frames.
    console
        Where to; standard error where not given.
    """

    def __init__(self, total: int, console: Console | None = None) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self.bar = Progress(
            TextColumn("{task.description:10}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("{task.fields[figures]}"),
            TimeRemainingColumn(compact=True),
            console=console or Console(stderr=True),
            transient=True,
        )
        self._task = self.bar.add_task("comparing", total=total, figures="")

    @contextmanager
    def shown(self) -> Iterator[Watcher]:
        """Show it for the time of the context."""
        with self.bar:
            yield self

    def __call__(self, calibrator: OnlineCalibrator, stage: str, frame: Frame | None = None) -> None:
        """Move on."""
        status = calibrator.status
        self.bar.update(self._task, completed=status.frames, description=stage, figures=figures(status))


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
    _pace: Pace = field(default_factory=Pace)
    _responses: list[FloatArray] = field(default_factory=list)
    _vignettes: list[FloatArray] = field(default_factory=list)
    _spreads: tuple[list[float], list[float]] = field(default_factory=lambda: ([], []))

    @contextmanager
    def shown(self) -> Iterator[Watcher]:
        """Show it for the time of the context."""
        from rich.console import Console
        from rich.live import Live

        console = self.console or Console(stderr=True)
        bar = ProgressBar(self.total, console)
        with Live(bar.bar, console=console, transient=True, auto_refresh=False) as live:

            def show(calibrator: OnlineCalibrator, stage: str, frame: Frame | None = None) -> None:
                if self._pace.due or stage != "comparing":
                    with self._pace.look():
                        bar(calibrator, stage, frame)
                        live.update(self.picture(bar.bar, calibrator.preview(), console.width), refresh=True)

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
        if preview.response is None or preview.vignette is None or preview.vignette_sigma is None:
            return
        response = preview.response.inverse(np.linspace(0, 1, 101))
        if self._responses and np.array_equal(response, self._responses[-1]):
            return
        spread = preview.response.inverse_sigma
        self._responses.append(response)
        self._vignettes.append(_profile(preview))
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


def _profile(preview: Preview) -> FloatArray:
    """Return the vignette from the centre to the corner at the lower right."""
    assert preview.vignette is not None
    half = (np.array(preview.vignette.size) - 1) / 2
    return np.asarray(preview.vignette.at(half + np.linspace(0, 1, _RADII)[:, None] * half))


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
