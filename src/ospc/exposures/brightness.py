"""Measure how the brightness of the same scene points changes between two frames, independent of the response."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, ImageSize, IntArray, count_reached, read_only
from ospc.correspondence.thumbnail import Thumbnail
from ospc.correspondence.thumbnail_registration import ThumbnailRegistration, exposed_in_both, pixel_places, values_at
from ospc.numerics.robust import median, robust_scale
from ospc.observations import Observations
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.settings.brightness import (
    BIN_OUTLIER_SIGMAS,
    GREY_BIN_EDGES,
    MAX_BIN_WEIGHT,
    MAX_RELATIVE_GRADIENT,
    MIN_BIN_PIXELS,
    MIN_BIN_SCATTER_LOG,
    MIN_MOTION_GRADIENT,
    MOTION_STRIDE,
    PIXEL_SAMPLES_PER_PAIR,
)
from ospc.settings.error_model import DARKEST_GREY
from ospc.settings.registration import MIN_OVERLAP


@dataclass(frozen=True)
class BrightnessChange:
    """The brightness change between two frames."""

    frame0: int
    frame1: int
    """Numbers of the frames."""
    log_ratio: FloatArray
    """Robust mean of ln M₁/M₀ over the flat points of each grey bin, shape (bins,); 0 for bins with too few."""
    weight: FloatArray
    """Number of flat points per bin, capped; 0 for bins with too few, shape (bins,)."""
    vignette_terms: FloatArray
    """Mean changes of R², R⁴, x and y over these points, in half diagonals, shape (bins, 4). The change of ln V of a
    possibly decentred vignette is approximately a linear combination of them."""
    overlap: float
    """Share of the first frame that is well exposed and visible in the second."""
    motion_px: float
    """Median displacement of textured points in pixels of the frame; NaN if there are too few."""


@dataclass(frozen=True)
class ComparedFrames:
    """Two frames whose brightness was compared: the change, and an even sample of the points behind it."""

    change: BrightnessChange
    points: Observations


class BrightnessComparer:
    """Compares the brightness of two frames, given their thumbnails."""

    def __init__(self) -> None:
        self._register = ThumbnailRegistration()

    def __call__(self, first: Thumbnail, second: Thumbnail) -> ComparedFrames:
        """Register two frames and compare the grey levels of points that are flat in both."""
        places1, found = self._register(first, second)
        # Black borders and saturated windows would appear static.
        visible = found & first.exposed
        if np.count_nonzero(visible) < MIN_OVERLAP * np.count_nonzero(first.exposed):
            found, visible = np.zeros_like(found), np.zeros_like(visible)
        grey1 = values_at(second.grey, places1)
        mean = np.sqrt(np.maximum(first.grey * grey1, DARKEST_GREY**2))
        # Indexing by integers is several times as fast as by a mask.
        flat = np.flatnonzero(
            _flat_places(first, second, places1, mean) & exposed_in_both(first, second, places1, found)
        )
        log_ratio = np.log(grey1.ravel()[flat] / first.grey.ravel()[flat])
        shift = places1 - pixel_places(places1.shape[1::-1])
        terms = _vignette_terms(places1, shift, flat)
        mean_log_ratio, weight, mean_terms = _binned(log_ratio, mean.ravel()[flat], terms)
        change = BrightnessChange(
            frame0=first.frame,
            frame1=second.frame,
            log_ratio=mean_log_ratio,
            weight=weight,
            vignette_terms=mean_terms,
            overlap=float(visible.mean()),
            motion_px=_median_motion_px(first, shift, visible),
        )
        return ComparedFrames(change, _sampled(first, second, grey1, places1, flat))


def _flat_places(first: Thumbnail, second: Thumbnail, places1: Float32Array, mean: Float32Array) -> BoolArray:
    """Return which pixels of the first frame are flat in both frames and lie within the grey bins, shape (h, w)."""
    steepest = np.maximum(first.gradient, values_at(second.gradient, places1))
    flat = steepest < MAX_RELATIVE_GRADIENT * mean
    return np.asarray(flat & (mean > GREY_BIN_EDGES[0]) & (mean < GREY_BIN_EDGES[-1]))


def _vignette_terms(places1: Float32Array, shift: Float32Array, flat: IntArray) -> Float32Array:
    """Return the changes of R², R⁴, x and y at the flat pixels, in half diagonals, shape (4, n)."""
    height, width = places1.shape[:2]
    squared = _squared_radius((width, height))
    squared0, squared1 = (image.ravel()[flat] for image in (squared, values_at(squared, places1)))
    x, y = shift.reshape(-1, 2).take(flat, axis=0).T / np.float32(np.hypot(width, height) / 2)
    return np.stack([squared1 - squared0, squared1**2 - squared0**2, x, y])


def _median_motion_px(first: Thumbnail, shift: Float32Array, visible: BoolArray) -> float:
    """Return the median displacement of textured points in pixels of the frame; NaN if there are too few."""
    structured = np.flatnonzero(visible & (first.gradient > MIN_MOTION_GRADIENT))[::MOTION_STRIDE]
    if structured.size < MIN_BIN_PIXELS:
        return float("nan")
    median_px = float(median(np.hypot(*shift.reshape(-1, 2).take(structured, axis=0).T)))
    return median_px * first.frame_width_px / int(visible.shape[1])


@cache
def _squared_radius(size: ImageSize) -> Float32Array:
    """Return R² at every pixel of a thumbnail, shape (h, w)."""
    return read_only(np.sum(normalised(pixel_grid(size), size) ** 2, axis=-1).astype(np.float32))


def _binned(
    log_ratio: Float32Array, grey: Float32Array, terms: Float32Array
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return robust means of the log ratio per grey bin, the bin weights, and the means of the vignette terms."""
    bins = len(GREY_BIN_EDGES) - 1
    mean, weight, mean_terms = np.zeros(bins), np.zeros(bins), np.zeros((bins, len(terms)))
    number = count_reached(GREY_BIN_EDGES, grey) - 1
    for b in range(bins):
        inside = np.flatnonzero(number == b)
        if len(inside) < MIN_BIN_PIXELS:
            continue
        values = log_ratio[inside]
        deviation = np.abs(values - median(values))
        # In single precision, like the values that are compared with it.
        scatter = np.float32(robust_scale(deviation)) + MIN_BIN_SCATTER_LOG
        kept = inside[deviation <= BIN_OUTLIER_SIGMAS * scatter]
        mean[b] = log_ratio[kept].mean()
        mean_terms[b] = terms.take(kept, axis=1).mean(axis=1)
        weight[b] = min(float(len(inside)), MAX_BIN_WEIGHT)
    return mean, weight, mean_terms


def _sampled(
    first: Thumbnail, second: Thumbnail, grey1: Float32Array, places1: Float32Array, flat: IntArray
) -> Observations:
    """Return an even sample of the flat points; ``grey1`` are the grey levels at their places in the second frame."""
    size = (places1.shape[1], places1.shape[0])
    step = max(1, len(flat) // PIXEL_SAMPLES_PER_PAIR)
    chosen = flat[step // 2 :: step]

    def seen_in(frame: int, grey: Float32Array, places: Float32Array) -> dict[str, npt.ArrayLike]:
        return {
            "grey": np.maximum(grey.ravel()[chosen].astype(np.float64), DARKEST_GREY),
            "position": normalised(places.reshape(-1, 2)[chosen].astype(np.float64), size),
            "frame": frame,
            # A thumbnail does not show the rest.
            **dict.fromkeys(
                ("grey_variance", "grey_third_moment", "gradient", "frame_moments", "surround_moments"), 0.0
            ),
        }

    seen = seen_in(first.frame, first.grey, pixel_places(size)), seen_in(second.frame, grey1, places1)
    return Observations.alternating(*seen, np.zeros(len(chosen)))
