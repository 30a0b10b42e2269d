"""Drawings of the data behind a calibration: exposures, coverage and residuals.

Every function draws into a cell of a matplotlib grid (a ``SubplotSpec``) and returns the axes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.errors import counted
from ospc.numerics.robust import weighted_median
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.report.curves import axes_in, draw_map, logarithmic, set_ticks
from ospc.report.style import BLACK, GREEN, GREY

FEW_SAMPLES = 50
"""A pair of frames with fewer samples may be wrongly matched, and is drawn as an open grey circle."""
_MOST_POINTS = 2000
"""Most points in a scatter plot; more would hide one another."""
_RESIDUAL_LABEL = "residual in % of irradiance"
_LEAST_RESIDUAL = 0.5
"""Smallest half range of a residual axis in per cent; smaller residuals are noise."""


def draw_exposures(cell: Any, exposures_ms: FloatArray, ratios: ExposureRatios, *, known: bool = True) -> Any:
    """Draw the exposure of every frame according to the metadata, and as estimated from pairs of images.

    Exposures that are not ``known`` are estimated from the images too, relative to their median.
    """
    axes = axes_in(cell)
    line, dots = ("metadata", "from the images") if known else ("estimated", "from pairs of frames")
    frames, estimated_ms = exposures_from_images(exposures_ms, ratios)
    chosen = _thinned(len(frames))
    axes.step(np.arange(len(exposures_ms)), exposures_ms, where="post", color=BLACK, lw=1, label=line)
    axes.plot(frames[chosen], estimated_ms[chosen], "o", color=GREEN, ms=3.5, mew=0, alpha=0.7, label=dots)
    axes.set(xlabel="frame", ylabel=_exposure_label(known=known), xlim=(0, max(1, len(exposures_ms) - 1)))
    low, high = _limits(exposures_ms, estimated_ms)
    logarithmic(axes, "y", low, high * (high / low) ** 0.25)  # room for the legend
    axes.legend(loc="upper left", ncols=2)
    return axes


def exposures_from_images(exposures_ms: FloatArray, ratios: ExposureRatios) -> tuple[IntArray, FloatArray]:
    """Return frames in ascending order and their exposures in ms as estimated from the images.

    A pair of frames gives the exposure of the later frame: the recorded exposure of the earlier frame, divided by
    the estimated ratio. Each frame gets the median over its pairs, weighted by their samples; pairs with few samples
    are not used.
    """
    pairs = np.flatnonzero(ratios.samples >= FEW_SAMPLES)
    first, second = ratios.frames[pairs].T
    later_ms, weight = exposures_ms[first] / ratios.estimated[pairs], ratios.samples[pairs]
    frames = np.unique(second)
    medians = [weighted_median(later_ms[second == frame], weight[second == frame]) for frame in frames]
    return frames, np.array(medians, dtype=np.float64)


def draw_ratios(cell: Any, ratios: ExposureRatios, *, known: bool = True) -> Any:
    """Draw the exposure ratios of pairs of frames as estimated from them, against those of the frames' exposures.

    These are from the metadata, or estimated from all images if they are not ``known``.
    """
    axes = axes_in(cell)
    chosen = _thinned(ratios.metadata.size)
    metadata, estimated = ratios.metadata[chosen], ratios.estimated[chosen]
    few = ratios.samples[chosen] < FEW_SAMPLES
    shown = np.ones_like(few) if few.all() else ~few
    low, high = _limits(metadata[shown], estimated[shown])
    axes.plot([low, high], [low, high], "--", color=BLACK, lw=1.2, label="equal", zorder=1)
    if not few.all():
        axes.plot(metadata[~few], estimated[~few], "o", color=GREEN, ms=4, mew=0, alpha=0.65, label="pair of frames")
    if few.any():
        label = f"pair with fewer than {FEW_SAMPLES} samples"
        axes.plot(metadata[few], estimated[few], "o", mfc="none", mec=GREY, ms=4, label=label)
    x_label = "exposure ratio k from the metadata" if known else "k of the estimated exposures"
    axes.set(xlabel=x_label, ylabel="k from the images" if known else "k of the pair alone")
    logarithmic(axes, "x", low, high)
    logarithmic(axes, "y", low, high * (high / low) ** 0.45)  # room for the legend
    title = f"median |Δ ln k| of all {counted(ratios.metadata.size, 'pair')}: {ratios.misfit:.2g}"
    axes.legend(loc="upper left", title=title, title_fontsize=8, alignment="left")
    return axes


def _exposure_label(*, known: bool) -> str:
    return "exposure in ms" if known else "exposure, relative to the median"


def draw_grey_coverage(cell: Any, coverage: Coverage, max_grey: int, *, known: bool = True) -> Any:
    """Draw the number of observations of each grey level at each exposure, in ms only if they are ``known``."""
    edges_ms, counts = coverage.exposure_edges_ms, coverage.grey_exposure
    axes = _draw_counts(cell, counts, (0, max_grey, 0, len(counts)))
    rows = np.unique(np.linspace(0, len(counts), min(len(counts), 5) + 1).round().astype(int))
    axes.set_yticks(rows, [f"{edges_ms[row]:.3g}" for row in rows])
    axes.set(xlabel="grey level M", ylabel=_exposure_label(known=known))
    return axes


def draw_radius_coverage(cell: Any, coverage: Coverage) -> Any:
    """Draw the number of observations by the radii of a scene point in the two frames."""
    axes = _draw_counts(cell, coverage.radius_radius + coverage.radius_radius.T, (0, 1, 0, 1))
    axes.plot([0, 1], [0, 1], "--", color=BLACK, lw=0.8)
    axes.set(xlabel="radius in one frame (1 = corner)", ylabel="radius in the other")
    return axes


def draw_place_residual(cell: Any, by_place: FloatArray) -> Any:
    """Draw the median residuals over the image, shape (rows, columns)."""
    known = np.abs(100 * by_place[np.isfinite(by_place)])
    extent = max(_LEAST_RESIDUAL, float(known.max(initial=0.0)))
    axes, _ = draw_map(cell, 100 * by_place, _RESIDUAL_LABEL, cmap="PuOr_r", vmin=-extent, vmax=extent)
    axes.set(xticks=[], yticks=[], xlabel="across the image", ylabel="down the image")
    return axes


def _draw_counts(cell: Any, counts: IntArray, extent: tuple[float, float, float, float]) -> Any:
    from matplotlib.colors import LogNorm

    most = max(10, int(counts.max()))
    seen = np.where(counts > 0, counts, np.nan)
    axes, bar = draw_map(
        cell, seen, "observations", cmap="Greens", norm=LogNorm(1, most), extent=extent, origin="lower", aspect="auto"
    )
    set_ticks(bar.yaxis, [10**e for e in range(10) if 10**e <= most])
    return axes


def draw_residual(cell: Any, quantiles: FloatArray, x_end: float, x_label: str, colour: str) -> Any:
    """Draw the median of the residuals and the band of two thirds of them, in equal classes from 0 to ``x_end``.

    ``quantiles`` has the lower limit, median and upper limit of each class, shape (classes, 3).
    """
    axes = axes_in(cell)
    middle = (np.arange(len(quantiles)) + 0.5) / len(quantiles) * x_end
    low, median, high = 100 * quantiles.T
    axes.axhline(0, color=BLACK, lw=0.8, ls="--")
    axes.fill_between(middle, low, high, color=colour, alpha=0.25, lw=0, label="two thirds of the observations")
    axes.plot(middle, median, color=colour, lw=1.8, label="median")
    known = np.abs(np.concatenate([low, high]))
    known = known[np.isfinite(known)]
    extent = 1.2 * max(_LEAST_RESIDUAL, float(np.quantile(known, 0.95)) if known.size else 0.0)
    axes.set(xlim=(0, x_end), ylim=(-extent, 1.3 * extent), xlabel=x_label, ylabel=_RESIDUAL_LABEL)
    axes.legend(loc="upper center", ncols=2)
    return axes


def _thinned(count: int) -> IntArray:
    """Return indices, evenly thinned if there are too many points to draw."""
    return np.arange(0, count, max(1, int(np.ceil(count / _MOST_POINTS))))


def _limits(*values: FloatArray) -> tuple[float, float]:
    """Return the limits of a logarithmic axis that shows the central 99 % of the positive values."""
    every = np.concatenate(values)
    low, high = np.quantile(every[np.isfinite(every) & (every > 0)], [0.005, 0.995])
    return float(low / 1.12), float(high * 1.12)
