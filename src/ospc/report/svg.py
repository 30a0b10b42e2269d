"""Small charts as SVG, drawn with the colours of the page they are in, light or dark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray

WIDTH = 430
_LEFT, _RIGHT, _TOP = 50, 12, 30
_BOTTOM, _BOTTOM_BARE = 40, 8
_SHADES = 9
_MOST_POINTS = 1500


@dataclass(frozen=True)
class Scale:
    """An axis: values from ``low`` to ``high``, evenly spaced or by their logarithm.

    Attributes
    ----------
    low, high
        Its ends; where ``low`` is the larger one, the axis runs backwards.
    label
        What it shows, with unit.
    logarithmic
        Whether equal ratios are equally long.
    """

    low: float
    high: float
    label: str = ""
    logarithmic: bool = False

    def place(self, values: npt.ArrayLike) -> FloatArray:
        """Return how far along the axis values lie, 0 at its low end and 1 at its high one."""
        found = np.asarray(values, dtype=np.float64)
        low, high = self.low, self.high
        if self.logarithmic:
            found, low, high = np.log(np.maximum(found, 1e-300)), float(np.log(low)), float(np.log(high))
        return np.asarray((found - low) / (high - low if high != low else 1.0))

    def ticks(self, most: int = 6) -> list[float]:
        """Return round values to mark."""
        if self.logarithmic:
            decades = [m * 10.0**e for e in range(-9, 10) for m in (1, 2, 5)]
            inside = [t for t in decades if self.low * 0.999 <= t <= self.high * 1.001]
            if len(inside) >= 3:
                return inside[:: int(np.ceil(len(inside) / most))]
        low, high = min(self.low, self.high), max(self.low, self.high)
        step = _round_step((high - low) / most)
        if step <= 0:
            return [self.low]
        first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
        return [float(n * step) for n in np.arange(first, last + 1)]


def _round_step(least: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is not less."""
    if not (np.isfinite(least) and least > 0):
        return 0.0
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= least * (1 - 1e-9)))


class Chart:
    """One chart; draw marks into it, then take :meth:`svg`.

    Marks are drawn in order, each with a class of the style sheet.

    Parameters
    ----------
    x, y
        The axes.
    title
        What it shows, for who cannot see it.
    height
        Of the area within the axes.
    bare
        Whether to leave out the numbers and the label of x, as where the chart below has them.
    """

    def __init__(self, x: Scale, y: Scale, title: str, *, height: int = 230, bare: bool = False) -> None:
        self._x, self._y, self._title = x, y, title
        self._w, self._h = WIDTH - _LEFT - _RIGHT, height
        self._bare = bare
        self._marks: list[str] = []

    def line(self, x: npt.ArrayLike, y: npt.ArrayLike, style: str) -> None:
        """Draw a line through points; it breaks where y is not finite."""
        self._path(_polyline(self._at_x(x), self._at_y(y)), f"line {style}")

    def steps(self, x: npt.ArrayLike, y: npt.ArrayLike, style: str) -> None:
        """Draw y as a level that holds until the next x."""
        self.line(np.repeat(np.asarray(x), 2)[1:], np.repeat(np.asarray(y), 2)[:-1], style)

    def band(self, x: npt.ArrayLike, low: npt.ArrayLike, high: npt.ArrayLike, style: str) -> None:
        """Fill the area between two lines, where both are finite."""
        across, below, above = self._at_x(x), self._at_y(low), self._at_y(high)
        known = np.isfinite(below) & np.isfinite(above)
        for part in np.split(np.arange(len(across)), np.flatnonzero(np.diff(known)) + 1):
            if known[part].all():
                there = _polyline(across[part], above[part])
                back = _polyline(across[part][::-1], below[part][::-1]).replace("M", "L", 1)
                self._path(f"{there}{back}Z", f"area {style}")

    def points(self, x: npt.ArrayLike, y: npt.ArrayLike, style: str) -> None:
        """Draw a dot at each point, of evenly chosen ones where there are very many."""
        across, up = self._at_x(x), self._at_y(y)
        chosen = np.flatnonzero(np.isfinite(across) & np.isfinite(up))
        chosen = chosen[:: int(np.ceil(len(chosen) / _MOST_POINTS)) or 1]
        self._path("".join(f"M{across[i]:.1f} {up[i]:.1f}h0" for i in chosen), f"dots {style}")

    def bars(self, edges: npt.ArrayLike, heights: npt.ArrayLike, style: str) -> None:
        """Draw a bar from the foot of the chart over each class."""
        across, up = self._at_x(edges), self._at_y(heights)
        outline = [
            f"M{a:.1f} {self._h}V{h:.1f}H{b:.1f}V{self._h}Z"
            for a, b, h in zip(across[:-1], across[1:], up, strict=True)
            if h < self._h
        ]
        self._path("".join(outline), f"area {style}")

    def shade(self, low: float, high: float, style: str) -> None:
        """Shade the whole height between two values of x."""
        if high > low:
            a, b = self._at_x([low, high])
            self._path(f"M{a:.1f} 0H{b:.1f}V{self._h}H{a:.1f}Z", f"area {style}")

    def cells(self, x_edges: npt.ArrayLike, y_edges: npt.ArrayLike, strength: FloatArray, style: str) -> None:
        """Fill the cells of a grid, the more strongly the larger a value in [0, 1] is; not at all where it is 0.

        Parameters
        ----------
        x_edges, y_edges
            Limits of the cells, shapes (columns + 1,) and (rows + 1,).
        strength
            Shape (rows, columns); NaN counts as 0.
        style
            Class of the style sheet.
        """
        across, up = self._at_x(x_edges), self._at_y(y_edges)
        shade = np.ceil(np.clip(np.nan_to_num(strength), 0, 1) * _SHADES).astype(int)
        for level in range(1, _SHADES + 1):
            outline = [
                f"M{across[c]:.1f} {up[r]:.1f}H{across[c + 1]:.1f}V{up[r + 1]:.1f}H{across[c]:.1f}Z"
                for r, c in np.argwhere(shade == level)
            ]
            if outline:
                self._path("".join(outline), f"cells {style}", f' fill-opacity="{level / _SHADES:.2f}"')

    def svg(self, *, bare: bool | None = None) -> str:
        """Return the chart as an SVG element, ``bare`` as at its making or changed."""
        self._bare = self._bare if bare is None else bare
        height = _TOP + self._h + (_BOTTOM_BARE if self._bare else _BOTTOM)
        return (
            f'<svg class="chart" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{escape(self._title)}">'
            f"{self._axes()}"
            f'<svg x="{_LEFT}" y="{_TOP}" width="{self._w}" height="{self._h}" '
            f'viewBox="0 0 {self._w} {self._h}">{"".join(self._marks)}</svg>'
            f'<path class="frame" d="M{_LEFT} {_TOP}V{_TOP + self._h}H{_LEFT + self._w}"/>'
            f"</svg>"
        )

    def _axes(self) -> str:
        foot = _TOP + self._h
        parts = [f'<text class="label" x="4" y="14">{escape(self._y.label)}</text>']
        for value in self._y.ticks(max(4, self._h // 40)):
            place = _TOP + float(self._at_y(value))
            if _TOP - 1 <= place <= foot + 1:
                parts.append(f'<path class="grid" d="M{_LEFT} {place:.1f}h{self._w}"/>')
                parts.append(f'<text class="tick end" x="{_LEFT - 6}" y="{place + 4:.1f}">{_number(value)}</text>')
        for value in self._x.ticks():
            place = _LEFT + float(self._at_x(value))
            parts.append(f'<path class="grid" d="M{place:.1f} {_TOP}v{self._h}"/>')
            if not self._bare:
                parts.append(f'<text class="tick mid" x="{place:.1f}" y="{foot + 16}">{_number(value)}</text>')
        if not self._bare:
            parts.append(
                f'<text class="label end" x="{WIDTH - _RIGHT}" y="{foot + 34}">{escape(self._x.label)}</text>'
            )
        return "".join(parts)

    def _path(self, outline: str, style: str, more: str = "") -> None:
        if outline:
            self._marks.append(f'<path class="{style}"{more} d="{outline}"/>')

    def _at_x(self, values: npt.ArrayLike) -> FloatArray:
        return self._x.place(values) * self._w

    def _at_y(self, values: npt.ArrayLike) -> FloatArray:
        place = (1 - self._y.place(values)) * self._h
        return np.clip(
            place, -2 * self._h, 3 * self._h
        )  # far outside is cut off anyway; endless digits are not drawn


def figure(charts: Sequence[str], keys: Sequence[tuple[str, str]], caption: str) -> str:
    """Return charts one above the other, with what their marks mean and what to see in them.

    Parameters
    ----------
    charts
        SVG elements.
    keys
        Class of the style sheet and meaning of each kind of mark.
    caption
        Plain text.
    """
    swatches = "".join(f'<li><span class="swatch {style}"></span>{escape(text)}</li>' for style, text in keys)
    listed = f'<ul class="keys">{swatches}</ul>' if keys else ""
    return f"<figure>{''.join(charts)}{listed}<figcaption>{escape(caption)}</figcaption></figure>"


def _polyline(across: FloatArray, up: FloatArray) -> str:
    known = np.isfinite(across) & np.isfinite(up)
    parts, pen = [], "M"
    for x, y, good in zip(across.tolist(), up.tolist(), known.tolist(), strict=True):
        if good:
            parts.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L" if good else "M"
    return "".join(parts)


def _number(value: float) -> str:
    return f"{round(value, 10) + 0.0:g}".replace("-", "−")  # adding 0 takes the sign from −0
