"""The scale of residuals and the middle of values, whatever the outliers are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ospc.arrays import Float32Array, FloatArray

SIGMA_OF_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over its median absolute value: 1 / Φ⁻¹(3/4)."""


def robust_scale(residuals: FloatArray | Float32Array) -> float:
    """Return the standard deviation of the normal distribution with the same median absolute value; 0 of none."""
    return float(np.median(np.abs(residuals)) * SIGMA_OF_MEDIAN) if residuals.size else 0.0


def weighted_median(values: FloatArray, weights: npt.ArrayLike) -> float:
    """Return the smallest value that, with all values below it, has half of the weight; NaN without values.

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
