"""Coverage, residuals and picture pairs as panels of a printed report."""

from __future__ import annotations

from typing import Any

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.coverage import Coverage
from ospc.report.evidence_charts import shown_exposures
from ospc.report.examples import PicturePair
from ospc.report.panels import logarithmic
from ospc.report.style import BLACK, BLUE, GREEN, ORANGE

_PERCENT = 100.0


def draw_exposures_stated(axes: Any, exposures_ms: FloatArray, ratios: ExposureRatios) -> None:
    """Draw the exposures stated of all frames, and those that the images themselves show."""
    frame, estimated_ms = shown_exposures(exposures_ms, ratios)
    axes.step(np.arange(len(exposures_ms)), exposures_ms, where="post", color=BLACK, lw=1, label="stated")
    axes.plot(frame, estimated_ms, "o", color=GREEN, ms=3.5, mew=0, alpha=0.7, label="shown by the images")
    axes.set(title="Exposures along the recording", xlabel="frame", ylabel="exposure in ms")
    every = np.concatenate([exposures_ms, estimated_ms])
    logarithmic(axes, float(every.min() / 1.1), float(every.max() * 1.1), "y")
    axes.legend(loc="best")


def draw_grey_coverage(axes: Any, coverage: Coverage, max_grey: int) -> None:
    """Draw how often each grey level was seen at each exposure."""
    counts = coverage.grey_exposure
    _draw_counts(axes, np.linspace(0, max_grey, counts.shape[1] + 1), coverage.exposure_edges_ms, counts)
    axes.set(title="Samples: grey × exposure", xlabel="grey level M", ylabel="exposure in ms")
    logarithmic(axes, float(coverage.exposure_edges_ms[0]), float(coverage.exposure_edges_ms[-1]), "y")


def draw_radius_coverage(axes: Any, coverage: Coverage) -> None:
    """Draw from which to which radius scene points moved."""
    counts = coverage.radius_radius
    edges = np.linspace(0, 1, len(counts) + 1)
    _draw_counts(axes, edges, edges, counts + counts.T)
    axes.plot([0, 1], [0, 1], "--", color=BLACK, lw=0.8)
    axes.set(title="Samples: radius × radius", xlabel="radius in one frame", ylabel="radius in the other")


def draw_grey_residual(axes: Any, by_grey: FloatArray, max_grey: int) -> None:
    """Draw the residuals over grey levels."""
    _draw_residual(axes, (np.arange(len(by_grey)) + 0.5) / len(by_grey) * max_grey, by_grey, BLUE)
    axes.set(title="Residual over grey levels", xlabel="grey level M", xlim=(0, max_grey))


def draw_radius_residual(axes: Any, by_radius: FloatArray) -> None:
    """Draw the residuals over radii."""
    _draw_residual(axes, (np.arange(len(by_radius)) + 0.5) / len(by_radius), by_radius, ORANGE)
    axes.set(title="Residual over the radius", xlabel="distance from the image centre (1 = corner)", xlim=(0, 1))


def draw_place_residual(axes: Any, by_place: FloatArray) -> None:
    """Draw the median residuals over the image."""
    known = np.abs(by_place[np.isfinite(by_place)])
    most = _PERCENT * max(0.005, float(known.max(initial=0.0)))
    shown = axes.imshow(_PERCENT * by_place, cmap="PuOr_r", vmin=-most, vmax=most)
    axes.figure.colorbar(shown, ax=axes, shrink=0.8, label="%")
    axes.set(title="Residual over the image", xticks=[], yticks=[])
    axes.grid(visible=False)


def draw_picture_pair(rows: Any, pair: PicturePair) -> None:
    """Draw two frames as recorded into the first row of axes, and corrected into the second."""
    for row, images, what in zip(rows, (pair.recorded, pair.corrected), ("as recorded", "corrected"), strict=True):
        for axes, image, frame, exposure_ms in zip(row, images, pair.frames, pair.exposures_ms, strict=True):
            axes.imshow(image, cmap="gray", vmin=0, vmax=255)
            axes.set_title(f"frame {frame}, {exposure_ms:.4g} ms, {what}", fontsize=8)
            axes.set_axis_off()


def _draw_counts(axes: Any, x_edges: FloatArray, y_edges: FloatArray, counts: IntArray) -> None:
    from matplotlib.colors import LogNorm

    shown = axes.pcolormesh(
        x_edges, y_edges, np.where(counts > 0, counts, np.nan), cmap="Greens", norm=LogNorm(1, max(2, counts.max()))
    )
    axes.figure.colorbar(shown, ax=axes, shrink=0.8)
    axes.grid(visible=False)


def _draw_residual(axes: Any, middle: FloatArray, quantiles: FloatArray, colour: str) -> None:
    low, median, high = _PERCENT * quantiles.T
    axes.fill_between(middle, low, high, color=colour, alpha=0.25, lw=0, label="two thirds of all samples")
    axes.plot(middle, median, color=colour, lw=1.8, label="median")
    axes.axhline(0, color=BLACK, lw=0.8, ls="--")
    extent = np.abs(np.concatenate([low, high]))
    if np.isfinite(extent).any():
        reach = 1.2 * max(0.5, float(np.nanquantile(extent, 0.95)))
        axes.set_ylim(-reach, reach)
    axes.set_ylabel("% of irradiance")
    axes.legend(loc="upper center", ncols=2)
