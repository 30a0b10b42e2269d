"""Exposures, coverage and residuals, as charts of a page."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.coverage import Coverage
from ospc.report.svg import Chart, Scale, figure
from ospc.report.words import least_samples, misfit_of

_PERCENT = 100.0
_LEAST_SPAN = 0.5
_LEAST_RANGE = 1.05


def exposures_figure(exposures_ms: FloatArray, ratios: ExposureRatios) -> str:
    """Return the exposures stated of all frames, and those that the images themselves show."""
    frame, estimated_ms = shown_exposures(exposures_ms, ratios)
    low, high = _limits(exposures_ms, estimated_ms)
    chart = Chart(
        Scale(0, max(1, len(exposures_ms) - 1), "frame"),
        Scale(low, high, "exposure in ms", logarithmic=True),
        "Exposures along the recording",
    )
    chart.steps(np.arange(len(exposures_ms)), exposures_ms, "ink thin")
    chart.points(frame, estimated_ms, "green")
    return figure(
        [chart.svg()],
        [("line ink", "stated"), ("dots green", "shown by the images")],
        "A dot is a frame's exposure as the images show it: that of an earlier frame, as stated, times the ratio "
        "between the two. Dots beside the line are exposures that belong to other frames, gain that changed unseen, "
        "or pairs that were not matched well.",
    )


def shown_exposures(exposures_ms: FloatArray, ratios: ExposureRatios) -> tuple[IntArray, FloatArray]:
    """Return frames and the exposure that images show for each: the median over its well-founded pairs."""
    pairs = np.flatnonzero(
        (ratios.samples >= least_samples(ratios)) & (ratios.frames.max(axis=1, initial=0) < len(exposures_ms))
    )
    first, second = ratios.frames[pairs].T
    later_ms = exposures_ms[first] / ratios.estimated[pairs]
    frames = np.unique(second)
    return frames, np.array([float(np.median(later_ms[second == f])) for f in frames])


def ratios_figure(ratios: ExposureRatios) -> str:
    """Return exposure ratios of pairs of frames from the images against those stated."""
    least = least_samples(ratios)
    founded = ratios.samples >= least
    shown = founded if founded.any() else np.ones_like(founded)
    low, high = _limits(ratios.metadata[shown], ratios.estimated[shown])
    scale = Scale(low, high, "exposure ratio k by the metadata", logarithmic=True)
    chart = Chart(scale, Scale(low, high, "k from the images", logarithmic=True), "Exposure ratios")
    chart.line([low, high], [low, high], "ink dashed")
    chart.points(ratios.metadata[~founded], ratios.estimated[~founded], "grey few")
    chart.points(ratios.metadata[founded], ratios.estimated[founded], "green")
    keys = [("dashed ink", "equal"), ("dots green", "pair of frames")]
    if not founded.all():
        keys.append(("dots grey few", f"{int((~founded).sum())} pairs of fewer than {least} samples"))
    return figure(
        [chart.svg()],
        keys,
        f"The closer to the line, the better images and exposures agree: here to {misfit_of(ratios):.2g} in ln k.",
    )


def grey_coverage_figure(coverage: Coverage, max_grey: int) -> str:
    """Return how often each grey level was seen at each exposure."""
    counts = coverage.grey_exposure
    edges = coverage.exposure_edges_ms
    if edges[-1] < _LEAST_RANGE * edges[0]:  # one exposure: one broad class
        counts = counts.sum(axis=0, keepdims=True)
        edges = np.sqrt(edges[0] * edges[-1]) * np.array([1 / _LEAST_RANGE, _LEAST_RANGE])
    chart = Chart(
        Scale(0, max_grey, "grey level M"),
        Scale(float(edges[0]), float(edges[-1]), "exposure in ms", logarithmic=True),
        "Samples by grey level and exposure",
    )
    chart.cells(np.linspace(0, max_grey, counts.shape[1] + 1), edges, _log_strength(counts), "green")
    return figure(
        [chart.svg()],
        [],
        f"Grey level × exposure, the stronger the more samples (most: {counts.max()}). A response needs the same "
        "light at several exposures: high columns are good, empty ones are grey levels nobody measured.",
    )


def radius_coverage_figure(coverage: Coverage) -> str:
    """Return from which to which radius scene points moved."""
    counts = coverage.radius_radius
    both = counts + counts.T
    edges = np.linspace(0, 1, len(counts) + 1)
    scale = Scale(0, 1, "radius in one frame, 1 = corner")
    chart = Chart(scale, Scale(0, 1, "radius in the other"), "Samples by radius in either frame")
    chart.cells(edges, edges, _log_strength(both), "green")
    chart.line([0, 1], [0, 1], "ink dashed")
    return figure(
        [chart.svg()],
        [],
        f"Radius × radius, the stronger the more samples (most: {both.max()}). A vignette needs points that moved "
        "between centre and corner: what lies away from the diagonal tells of it, what lies on it does not.",
    )


def grey_residual_figure(by_grey: FloatArray, max_grey: int) -> str:
    """Return the residuals over grey levels."""
    middle = (np.arange(len(by_grey)) + 0.5) / len(by_grey) * max_grey
    return _residual_figure(
        middle,
        by_grey,
        Scale(0, max_grey, "grey level M"),
        "blue",
        "What is left over grey levels. A line that keeps away from zero means the response bends where the model "
        "does not; the width is noise and imperfect matching.",
    )


def radius_residual_figure(by_radius: FloatArray) -> str:
    """Return the residuals over radii."""
    middle = (np.arange(len(by_radius)) + 0.5) / len(by_radius)
    return _residual_figure(
        middle,
        by_radius,
        Scale(0, 1, "distance from the image centre, 1 = corner"),
        "orange",
        "What is left over the distance from the centre: the same for the vignette.",
    )


def place_residual_figure(by_place: FloatArray) -> str:
    """Return the residuals over the image."""
    rows, columns = by_place.shape
    known = np.abs(by_place[np.isfinite(by_place)])
    most = max(0.005, float(known.max(initial=0.0)))
    x, y = Scale(0, 1, "x, of the image's width"), Scale(1, 0, "y, of its height")
    chart = Chart(x, y, "Residuals over the image", height=round(368 * rows / columns))
    edges = np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1)
    chart.cells(*edges, by_place / most, "orange")
    chart.cells(*edges, -by_place / most, "blue")
    return figure(
        [chart.svg()],
        [("area orange", f"too bright, up to {_PERCENT * most:.1f} %"), ("area blue", "too dark")],
        "What is left over the image. A patch of one colour that stays means shading that the vignette's model does "
        "not have, or dirt; a mixture of both is chance.",
    )


def _residual_figure(middle: FloatArray, quantiles: FloatArray, x: Scale, colour: str, caption: str) -> str:
    low, median, high = _PERCENT * quantiles.T
    known = np.abs(np.concatenate([low, high]))
    extent = (
        max(_LEAST_SPAN, 1.1 * float(np.quantile(known[np.isfinite(known)], 0.95))) if np.isfinite(known).any() else 1
    )
    chart = Chart(x, Scale(-extent, extent, "residual in % of irradiance"), "Residuals", height=170)
    chart.band(middle, low, high, f"{colour} wide")
    chart.line([x.low, x.high], [0, 0], "ink dashed")
    chart.line(middle, median, colour)
    return figure(
        [chart.svg()], [(f"line {colour}", "median"), (f"area {colour} wide", "two thirds of all samples")], caption
    )


def _log_strength(counts: IntArray) -> FloatArray:
    """Return the logarithm of counts, 1 for the largest, 0 for none."""
    strength = np.log1p(counts) / max(np.log1p(counts.max()), 1e-12)
    return np.asarray(np.where(counts > 0, np.maximum(strength, 0.12), 0.0))


def _limits(*values: FloatArray) -> tuple[float, float]:
    """Return limits around values, robust against a few that are far off."""
    every = np.concatenate(values)
    every = every[np.isfinite(every) & (every > 0)]
    low, high = np.quantile(every, [0.005, 0.995])
    return float(low / 1.12), float(high * 1.12)
