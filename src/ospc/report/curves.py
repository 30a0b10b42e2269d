"""Drawings of response and vignette with their uncertainty.

Every function draws into a cell of a matplotlib grid (a ``SubplotSpec``) and returns the topmost axes.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, diagonal_profile, usable_radius_of
from ospc.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, printable

RADIUS_LABEL = "distance from the image centre (1 = corner)"

_BANDS = ((2, 0.2), (1, 0.35))
"""Multiples of the standard deviation that are shown as bands, with their opacities."""
_PANEL_HEIGHTS = (3.0, 1.1, 0.9)
"""Relative heights of the panels of the curve, its error, and the number of observations."""
_MOST_LEVELS = 257
"""Points of a drawn response: as smooth as a screen can show."""
_LEAST_EXTENT = 1e-4
"""Smallest half height of an error panel; smaller errors are negligible."""
_MOST_TICKS = 6
"""Most intervals between the ticks of an axis."""
_LABEL_IN = 0.66
"""Distance of the label of a y axis from the axis, in inches, with room for the tick labels."""
_BAR_WIDTHS = (20, 1, 4.5)
"""Relative widths of an image, its colour bar, and the labels of the colour bar."""
_MAP_COLUMNS = 240
"""Cells in a row of the vignette map."""
_MAP_STEPS = 9
"""Most steps of attenuation in the vignette map; more colours could not be distinguished."""
_WRAP_COLUMNS = 38
"""Characters per line of a text in place of a curve."""


@dataclass(frozen=True)
class _Curve:
    """A curve to draw, as a function of increasing x; arrays of shape (points,). ``measured`` has observations."""

    x: FloatArray
    value: FloatArray
    sigma: FloatArray | None
    reference: FloatArray | None
    colour: str
    name: str
    x_label: str
    measured: tuple[float, float] = (0.0, 1.0)


def draw_response(cell: Any, calibration: Calibration, reference: Response | None = None) -> Any:
    """Draw g over grey levels, an enlarged view of the uncertainty and error of its shape, and the observations.

    Grey levels outside the measured range are shaded. A reference is scaled to agree at the grey level to which the
    uncertainty is relative.
    """
    response, white = calibration.response, calibration.max_grey
    assert response is not None
    low, high = (end * white for end in response.support)
    index = np.unique(np.linspace(0, response.inverse_table.size - 1, _MOST_LEVELS).round().astype(int))
    curve = _Curve(
        x=response.levels[index] * white,
        value=response.inverse_table[index],
        sigma=None if response.inverse_sigma is None else response.inverse_sigma[index],
        reference=None if reference is None else response.matched(reference)[index],
        colour=BLUE,
        name="g",
        x_label="grey level M",
        measured=(low, high),
    )
    panels = _panels(cell, curve, None if calibration.coverage is None else calibration.coverage.by_grey)
    _shade(panels, "extrapolated", (0.0, low), (high, float(white)))
    panels[0].set(ylim=(0, 1.02), ylabel="irradiance g(M)")
    _legend(panels[0], "upper left")
    return panels[0]


def draw_vignette(cell: Any, calibration: Calibration, reference: Vignette | None = None) -> Any:
    """Draw V over the radius, an enlarged view of its uncertainty and error, and the number of observations.

    The part of the image where V is unknown is shaded.
    """
    vignette, usable = calibration.vignette, usable_radius_of(calibration.vignette)
    assert vignette is not None
    curve = _Curve(
        x=PROFILE_RADII,
        value=diagonal_profile(vignette, PROFILE_RADII),
        sigma=calibration.vignette_sigma,
        reference=None if reference is None else diagonal_profile(reference, PROFILE_RADII),
        colour=ORANGE,
        name="V",
        x_label=RADIUS_LABEL,
        measured=(0.0, usable),
    )
    panels = _panels(cell, curve, None if calibration.coverage is None else calibration.coverage.by_radius)
    _shade(panels, "unknown", (usable, 1.0))
    lowest = min(float(v.min()) for v in (curve.value, curve.reference) if v is not None)
    panels[0].set(ylim=(max(min(0.9, lowest - 0.08), 0.0), 1.04), ylabel="attenuation V")
    _legend(panels[0], "lower left")
    return panels[0]


def _shade(panels: Sequence[Any], label: str, *parts: tuple[float, float]) -> None:
    """Shade parts of the x axis of all panels."""
    for axes in panels:
        for start, end in parts:
            if end > start:
                axes.axvspan(start, end, color=GREY, alpha=0.25, lw=0, label=label)


def draw_vignette_map(cell: Any, vignette: Vignette) -> Any:
    """Draw V over the image, with steps at round numbers."""
    from matplotlib.colors import BoundaryNorm
    from matplotlib.ticker import MaxNLocator

    width, height = vignette.size
    columns, rows = min(_MAP_COLUMNS, width), max(1, min(height, round(_MAP_COLUMNS * height / width)))
    x, y = np.meshgrid(np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows))
    values = vignette.at(np.stack([x, y], axis=-1))
    steps = MaxNLocator(_MAP_STEPS).tick_values(float(values.min()), max(float(values.max()), values.min() + 1e-3))
    axes, _ = draw_map(
        cell, values, "attenuation V", cmap="cividis", norm=BoundaryNorm(steps, 256), extent=(0, width, height, 0)
    )
    axes.set(xlabel="x in pixels", ylabel="y in pixels")
    return axes


def axes_in(cell: Any) -> Any:
    """Return new axes that fill a cell of a grid."""
    from matplotlib.transforms import ScaledTranslation

    figure = cell.get_gridspec().figure
    axes = figure.add_subplot(cell)
    axes.locator_params(nbins=_MOST_TICKS)
    place = ScaledTranslation(-_LABEL_IN, 0, figure.dpi_scale_trans)
    axes.yaxis.set_label_coords(0, 0.5, transform=axes.transAxes + place)
    return axes


def draw_map(cell: Any, values: FloatArray, label: str, **how: Any) -> tuple[Any, Any]:
    """Draw values as an image with options of ``imshow``; return its axes, and those of the labelled colour bar."""
    image, bar, _room_for_numbers = cell.subgridspec(1, 3, width_ratios=_BAR_WIDTHS, wspace=0.04)
    axes = axes_in(image)
    axes.grid(visible=False)
    bar_axes = axes.figure.add_subplot(bar)
    axes.figure.colorbar(axes.imshow(values, interpolation="none", **how), cax=bar_axes, label=label)
    return axes, bar_axes


def logarithmic(axes: Any, name: str, low: float, high: float) -> None:
    """Scale an axis, "x" or "y", logarithmically between two limits, with a few round numbers as ticks."""
    from matplotlib.ticker import MaxNLocator

    for multiples in ((1, 2, 5), (1, 3), (1,)):
        ticks = [m * 10.0**e for e in range(-9, 13) for m in multiples if low <= m * 10.0**e <= high]
        if len(ticks) <= _MOST_TICKS:
            break
    ticks = ticks[:: max(1, -(-len(ticks) // _MOST_TICKS))]
    if len(ticks) < 3 and high < 10 * low:
        ticks = [tick for tick in MaxNLocator(5).tick_values(low, high) if low <= tick <= high]
    axes.set(**{f"{name}scale": "log", f"{name}lim": (low, high)})
    set_ticks(getattr(axes, f"{name}axis"), ticks)


def set_ticks(axis: Any, ticks: Sequence[float]) -> None:
    """Give an axis these ticks, and no others, with short labels."""
    from matplotlib.ticker import FixedLocator, NullLocator

    axis.set_major_locator(FixedLocator(ticks))
    axis.set_major_formatter(lambda value, _position: f"{value:g}")
    axis.set_minor_locator(NullLocator())


def _panels(cell: Any, curve: _Curve, observations: IntArray | None) -> list[Any]:
    """Draw a curve, with panels for its error if known, and the number of observations if counted."""
    judged = curve.sigma is not None or curve.reference is not None
    shown = [True, judged, observations is not None]
    heights = [height for height, is_shown in zip(_PANEL_HEIGHTS, shown, strict=True) if is_shown]
    grid = cell.subgridspec(len(heights), 1, height_ratios=heights, hspace=0.12)
    panels = [axes_in(grid[row]) for row in range(len(heights))]
    _draw_bands(panels[0], curve)
    panels[0].plot(curve.x, curve.value, color=curve.colour, lw=1.8, label="estimate")
    if curve.reference is not None:
        panels[0].plot(curve.x, curve.reference, "--", color=BLACK, lw=1.2, label="reference")
    if judged:
        _draw_error(panels[1], curve)
    if observations is not None:
        edges = np.linspace(curve.x[0], curve.x[-1], len(observations) + 1)
        panels[-1].stairs(observations, edges, fill=True, color=GREEN, alpha=0.6, baseline=0.1)
        panels[-1].set_ylabel("count")
        logarithmic(panels[-1], "y", 1.0, max(10.0, 1.5 * float(observations.max())))
    for axes in panels:
        axes.set_xlim(curve.x[0], curve.x[-1])
        axes.tick_params(labelbottom=axes is panels[-1])
    panels[-1].set_xlabel(curve.x_label)
    return panels


def _draw_error(axes: Any, curve: _Curve) -> None:
    _draw_bands(axes, replace(curve, value=np.zeros_like(curve.value)))
    axes.axhline(0, color=curve.colour, lw=1)
    # The bands of extrapolated parts may be so wide that the others could not be seen.
    seen = (curve.x >= curve.measured[0]) & (curve.x <= curve.measured[1])
    extent = 0.0 if curve.sigma is None else 2 * float(curve.sigma.max(where=seen, initial=0.0))
    if curve.reference is not None:
        error = curve.value - curve.reference
        extent = max(extent, float(np.abs(error).max(where=seen, initial=0.0)))
        axes.plot(curve.x, error, color=BLACK, lw=1.2)
    extent = 1.15 * max(extent, _LEAST_EXTENT)
    label = f"{'±σ' if curve.reference is None else 'error'} of {curve.name}"
    axes.set(ylim=(-extent, extent), ylabel=label)
    axes.locator_params(axis="y", nbins=4)


def _draw_bands(axes: Any, curve: _Curve) -> None:
    if curve.sigma is None:
        return
    for times, opacity in _BANDS:
        low, high = curve.value - times * curve.sigma, curve.value + times * curve.sigma
        axes.fill_between(curve.x, low, high, color=curve.colour, alpha=opacity, lw=0, label=f"±{times}σ")


def _legend(axes: Any, place: str) -> None:
    """Add a legend with one entry per kind of mark, the estimate first."""
    handles, labels = axes.get_legend_handles_labels()
    by_label = dict(zip(labels, handles, strict=True))
    order = [name for name in ("estimate", "±1σ", "±2σ", "reference", "extrapolated", "unknown") if name in by_label]
    axes.legend([by_label[name] for name in order], order, loc=place)


def draw_text(cell: Any, text: str) -> Any:
    """Write a text in place of a curve."""
    axes = axes_in(cell)
    text = textwrap.fill(printable(text), _WRAP_COLUMNS)
    axes.set(xticks=[], yticks=[])
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, parse_math=False)
    return axes
