"""Counts and curves as characters of a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ospc.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from rich.text import Text

_BARS = "▁▂▃▄▅▆▇█"
_NOTHING = "·"
_BRAILLE = 0x2800
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])


def bars(counts: IntArray) -> str:
    """Return a bar for each count, its height by the logarithm; a dot in the middle where there is none."""
    heights = np.log1p(counts) / max(float(np.log1p(counts.max(initial=0))), 1e-12)
    steps = np.clip(np.ceil(heights * len(_BARS)).astype(int), 1, len(_BARS)) - 1
    return "".join(_BARS[step] if count else _NOTHING for step, count in zip(steps, counts, strict=True))


def filled(share: float, most: int) -> str:
    """Return a bar that is full at a share of 1."""
    full = int(np.clip(share, 0, 1) * most)
    return "█" * full + "░" * (most - full)


def falling(values: list[float], most: int) -> str:
    """Return a bar for each of the latest positive values, their heights by the logarithm from the lowest up."""
    logs = np.log(np.maximum(values[-most:], 1e-12))
    span = max(float(np.ptp(logs)), 1e-12) if len(logs) else 1.0
    steps = np.rint((logs - logs.min(initial=np.inf)) / span * (len(_BARS) - 1)).astype(int)
    return "".join(_BARS[step] for step in steps)


class Canvas:
    """Curves in a frame of characters, each of which is two dots wide and four dots high."""

    def __init__(self, columns: int, rows: int) -> None:
        self._shape = (rows, columns)
        self._marks = np.zeros(self._shape, dtype=np.int64)
        self._styles = np.zeros(self._shape, dtype=np.int64)
        self._names: list[str] = []

    def line(self, y: FloatArray, style: str) -> None:
        """Draw a curve of even steps from the left edge to the right one over what was drawn before.

        Heights are 0 at the foot and 1 at the head; what is outside is not drawn. The style is one of rich's.
        """
        rows, columns = self._shape
        self._names.append(style)
        # Several dots a column, so that steep parts have no gaps.
        share = np.linspace(0, 1, 16 * columns)
        height = np.interp(share, np.linspace(0, 1, len(y)), y)
        across = np.minimum((share * 2 * columns).astype(int), 2 * columns - 1)
        down = np.floor((1 - height) * (4 * rows - 1) + 0.5)
        inside = np.isfinite(height) & (down >= 0) & (down < 4 * rows)
        across, down = across[inside], down[inside].astype(int)
        cell = (down // 4, across // 2)
        np.bitwise_or.at(self._marks, cell, _DOTS[down % 4, across % 2])
        self._styles[cell] = len(self._names)

    def text(self) -> Text:
        """Return the drawing."""
        from rich.text import Text

        drawn = Text()
        for marks, styles in zip(self._marks.tolist(), self._styles.tolist(), strict=True):
            for mark, style in zip(marks, styles, strict=True):
                drawn.append(chr(_BRAILLE + mark), self._names[style - 1] if style else "")
            drawn.append("\n")
        drawn.rstrip()
        return drawn
