"""Robust estimates of scale and location."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ospc.arrays import Float32Array, FloatArray, IntArray

SIGMA_OF_MEDIAN = 1.4826
"""Ratio of the standard deviation of a normal distribution to its median absolute value: 1 / Φ⁻¹(3/4)."""

ERROR_OF_SCALE = 1.17
"""Relative standard deviation of :func:`robust_scale` of n normal values, multiplied by √n."""

VARIANCE_OF_MEDIAN = float(np.pi / 2)
"""Variance of the median of many normal values, relative to that of their mean."""

TAIL, SIGMAS_OF_TAIL = 0.95, 1.96
"""Share of absolute values that :func:`tail_scale` measures, and its quantile of the standard normal distribution."""


def median(values: FloatArray | Float32Array) -> FloatArray | Float32Array:
    """Return the median of finite values along the last axis, shape (..., n) -> (...).

    NumPy's function, which also looks for NaN, takes up to ten times as long.
    """
    n = values.shape[-1]
    parted: Any = np.partition(values, n // 2, axis=-1)
    upper = parted[..., n // 2]
    lower = upper if n % 2 else parted[..., : n // 2].max(axis=-1)
    return np.asarray((lower + upper) / 2)


def robust_scale(residuals: FloatArray | Float32Array) -> float:
    """Return the standard deviation of the normal distribution with the same median absolute value; 0 if empty."""
    return float(robust_scales(residuals.ravel()))


def robust_scales(residuals: FloatArray | Float32Array) -> FloatArray | Float32Array:
    """Return :func:`robust_scale` along the last axis, shape (..., n) -> (...)."""
    if not residuals.size:
        return np.zeros(residuals.shape[:-1])
    return np.asarray(median(np.abs(residuals)) * SIGMA_OF_MEDIAN)


def huber_weights(residuals: FloatArray, threshold: float) -> FloatArray:
    """Return weights (Huber 1964): 1 for residuals up to a positive threshold, less above; of the same shape."""
    return np.asarray(threshold / np.maximum(np.abs(residuals), threshold))


def tail_scale(residuals: FloatArray) -> float:
    """Return the standard deviation of the normal distribution with the same 95 % quantile; 0 if empty."""
    return float(np.quantile(np.abs(residuals), TAIL) / SIGMAS_OF_TAIL) if residuals.size else 0.0


def weighted_median(values: FloatArray, weights: npt.ArrayLike) -> float:
    """Return the smallest value up to which the weights sum to at least half of the total; NaN without values.

    Parameters
    ----------
    values
        Shape (n,).
    weights
        Not negative, shape (n,).
    """
    if not values.size:
        return float("nan")
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(np.asarray(weights, dtype=np.float64)[order])
    return float(values[order][np.searchsorted(cumulative, cumulative[-1] / 2)])


def medians(values: FloatArray, group: IntArray) -> FloatArray:
    """Return the median of each group of values, ordered by group number.

    ``values`` and ``group``, whose numbers start at 0 without gaps, have shape (n,).
    """
    ordered, count = values[np.argsort(group, kind="stable")], np.bincount(group)
    begins = np.cumsum(count) - count
    for own in np.split(ordered, begins[1:]):  # sorting by group and value at once takes ten times as long
        own.sort()
    return np.asarray((ordered[begins + (count - 1) // 2] + ordered[begins + count // 2]) / 2)
