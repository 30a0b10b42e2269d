"""A guided capture in the terminal: the instruction, bars and curves; or lines of text outside a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ospc.arrays import FloatArray, IntArray
from ospc.cli.terminal import console, say, spreads_in_words
from ospc.errors import counted
from ospc.exposures.table import range_in_words
from ospc.live.capture import Capture
from ospc.live.status import LiveStatus
from ospc.methods.preview import Preview
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.vignette import diagonal_profile
from ospc.throttle import Throttle

_BARS = "▁▂▃▄▅▆▇█"
_NOTHING = "·"
_BRAILLE = 0x2800
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])


def bars(counts: IntArray) -> str:
    """Return a bar of logarithmic height for each count, and a centred dot for zero."""
    heights = np.log1p(counts) / max(float(np.log1p(counts.max(initial=0))), 1e-12)
    steps = np.clip(np.ceil(heights * len(_BARS)).astype(int), 1, len(_BARS)) - 1
    return "".join(_BARS[step] if count else _NOTHING for step, count in zip(steps, counts, strict=True))


def filled(share: float, most: int) -> str:
    """Return a horizontal bar that is full at a share of 1."""
    full = int(np.clip(share, 0, 1) * most)
    return "█" * full + "░" * (most - full)


def falling(values: list[float], most: int) -> str:
    """Return a bar of logarithmic height for each of the latest positive values."""
    logs = np.log(np.maximum(values[-most:], 1e-12))
    span = max(float(np.ptp(logs)), 1e-12) if len(logs) else 1.0
    steps = np.rint((logs - logs.min(initial=np.inf)) / span * (len(_BARS) - 1)).astype(int)
    return "".join(_BARS[step] for step in steps)


def drawn(curves: Iterable[tuple[FloatArray, str]], columns: int, rows: int) -> Text:
    """Return curves drawn over one another in Braille characters, each of which is two dots wide and four high.

    Each curve has equidistant values from the left edge to the right edge, and a rich style. Values are 0 at the
    bottom and 1 at the top; values outside are not drawn.
    """
    marks, styles = np.zeros((2, rows, columns), dtype=np.int64)
    names = [""]
    # Several samples per column, so that steep parts have no gaps.
    share = np.linspace(0, 1, 16 * columns)
    dot_columns = np.minimum((share * 2 * columns).astype(int), 2 * columns - 1)
    for y, style in curves:
        height = np.interp(share, np.linspace(0, 1, len(y)), y)
        dot_rows = np.floor((1 - height) * (4 * rows - 1) + 0.5)
        inside = np.isfinite(height) & (dot_rows >= 0) & (dot_rows < 4 * rows)
        across, down = dot_columns[inside], dot_rows[inside].astype(int)
        cell = (down // 4, across // 2)
        np.bitwise_or.at(marks, cell, _DOTS[down % 4, across % 2])
        styles[cell] = len(names)
        names.append(style)
    lines = (
        Text.assemble(*((chr(_BRAILLE + mark), names[style]) for mark, style in zip(*row, strict=True)))
        for row in zip(marks.tolist(), styles.tolist(), strict=True)
    )
    return Text("\n").join(lines)


_REFRESH_S = 0.4
"""Shortest time between two updates, in seconds."""

_LARGEST_SHARE = 0.03
"""Largest share of the time spent on the display."""

_LINE_S = 5.0
"""Time between two lines outside a terminal, if the instruction stays the same, in seconds."""

_BAR = 20
"""Width of a bar in characters."""

_EARLIER_CURVES = 5
_MOST_COLUMNS, _ROWS = 42, 9
"""Size of a drawing in characters."""

Shown = Callable[[], None]
"""Called after every frame."""


@contextmanager
def shown(capture: Capture, *, quiet: bool, full: bool) -> Iterator[Shown]:
    """Show a capture in the terminal within the context; with ``full``, with the bars and curves of the page."""
    if quiet:
        yield lambda: None
    elif sys.stderr.isatty() and full:
        with LiveView(capture).shown() as show:
            yield show
    else:
        yield _lines(capture)


def _lines(capture: Capture) -> Shown:
    """Return a function that prints a line for every new instruction and every few seconds, for programs and logs."""
    text, next_s = "", 0.0

    def show() -> None:
        nonlocal text, next_s
        status, now_s = capture.live.status, time.monotonic()
        if status.advice != text or now_s >= next_s:
            text, next_s = status.advice, now_s + _LINE_S
            in_words = "  ".join(f"{name} {share:.0%}" for name, share in asdict(capture.bars).items())
            say(f"{_figures(status)}  {in_words}", err=True)
            say(f"  → {text}", err=True)

    return show


@dataclass
class LiveView:
    """Shows instruction, bars and converging curves, updated about twice a second; on standard error by default."""

    capture: Capture
    console: Console | None = None
    _throttle: Throttle = field(default_factory=partial(Throttle, _REFRESH_S, _LARGEST_SHARE))
    _responses: list[FloatArray] = field(default_factory=list)
    _vignettes: list[FloatArray] = field(default_factory=list)
    _spreads: tuple[list[float], list[float]] = field(default_factory=lambda: ([], []))

    @contextmanager
    def shown(self) -> Iterator[Shown]:
        """Show it within the context."""
        on = self.console or console(stderr=True)
        with Live(console=on, transient=True, auto_refresh=False) as live:

            def show() -> None:
                if self._throttle.due:
                    with self._throttle.timed():
                        live.update(self.picture(on.width), refresh=True)

            yield show

    def picture(self, width: int) -> RenderableType:
        """Return the current display, at most ``width`` characters wide, and remember its curves."""
        status, preview = self.capture.live.status, self.capture.live.preview
        parts: list[RenderableType] = [Text(status.advice, style="bold"), Text(_figures(status), style="dim")]
        for name, share in asdict(self.capture.bars).items():
            parts.append(Text.assemble(f"{name:10} ", (filled(share, _BAR), "green"), f" {share:4.0%}"))
        if preview is not None:
            self._remember(preview)
            parts += [_coverage(preview), self._curves(width)]
        return Group(*parts)

    def _remember(self, preview: Preview) -> None:
        spread = None if preview.response is None else preview.response.inverse_sigma
        if preview.response is None or spread is None or preview.vignette is None or preview.vignette_sigma is None:
            return
        response = preview.response.inverse(np.linspace(0, 1, 101))
        if self._responses and np.array_equal(response, self._responses[-1]):
            return
        self._responses.append(response)
        self._vignettes.append(diagonal_profile(preview.vignette, PROFILE_RADII))
        self._spreads[0].append(float(spread.max()))
        self._spreads[1].append(float(preview.vignette_sigma[-1]))

    def _curves(self, width: int) -> RenderableType:
        columns = max(8, min(_MOST_COLUMNS, width // 2 - 3))
        table = Table(box=None, padding=(0, 2, 0, 0))
        drawings, captions = [], []
        for name, curves, spreads, colour in (
            ("response g(M)", self._responses, self._spreads[0], "bright_blue"),
            ("vignette V(R)", self._vignettes, self._spreads[1], "bright_yellow"),
        ):
            table.add_column(name, header_style="bold", width=columns, no_wrap=True)
            latest = curves[-1 - _EARLIER_CURVES :]
            styles = ["bright_black"] * (len(latest) - 1) + [colour]
            drawings.append(drawn(zip(latest, styles, strict=False), columns, _ROWS))
            captions.append(f"±{spreads[-1]:.2g}  {falling(spreads, columns - 10)}" if spreads else "no estimate yet")
        table.add_row(*drawings)
        table.add_row(*captions)
        return table


def _figures(status: LiveStatus) -> str:
    parts = [counted(status.frames, "frame"), counted(status.progress.pairs, "pair")]
    if status.dropped:
        parts.append(f"{status.dropped} dropped")
    now = status.instruction
    return "  ".join([*parts, *spreads_in_words(now.response_sigma, now.vignette_sigma)])


def _coverage(preview: Preview) -> RenderableType:
    seen = preview.coverage
    low, high = seen.exposure_edges_ms[[0, -1]]
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_row("grey levels", f"[green]{bars(seen.by_grey)}[/]", "black to white")
    table.add_row("exposures", f"[green]{bars(seen.grey_exposure.sum(axis=1))}[/]", range_in_words(low, high))
    table.add_row("radii", f"[green]{bars(seen.by_radius)}[/]", "centre to corner; · not seen")
    return table
