"""The scale of residuals, whatever outliers there are."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray

_SIGMA_OF_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over its median absolute value: 1 / Φ⁻¹(3/4)."""


def robust_scale(residuals: FloatArray) -> float:
    """Return the standard deviation a normal distribution of the same median absolute value would have."""
    return float(np.median(np.abs(residuals)) * _SIGMA_OF_MEDIAN) if residuals.size else 0.0
