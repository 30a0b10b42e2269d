"""The scale of residuals, whatever the outliers are."""

from __future__ import annotations

import numpy as np

from ospc.arrays import Float32Array, FloatArray

SIGMA_OF_MEDIAN = 1.4826
"""Standard deviation of a normal distribution over its median absolute value: 1 / Φ⁻¹(3/4)."""


def robust_scale(residuals: FloatArray | Float32Array) -> float:
    """Return the standard deviation of the normal distribution with the same median absolute value; 0 of none."""
    return float(np.median(np.abs(residuals)) * SIGMA_OF_MEDIAN) if residuals.size else 0.0
