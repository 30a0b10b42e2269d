"""Weights that limit the influence of outliers."""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.numerics.robust import robust_scale
from ospc.settings.fit import MIN_SANDWICH_FACTOR, WEIGHT_CUT_SIGMAS, WEIGHT_SCALE_SIGMAS


def redescending_weights(studentised: FloatArray, usable: BoolArray) -> tuple[FloatArray, float]:
    """Return redescending weights (Geman and McClure 1987, truncated), and E[ψ'] / E[w] of the non-zero ones.

    Studentised residuals and whether an observation may have any weight have shape (n,).
    """
    scaled = studentised / (WEIGHT_SCALE_SIGMAS * max(robust_scale(studentised[usable]), 1e-6))
    squared = scaled**2
    counts = usable & (np.abs(scaled) < WEIGHT_CUT_SIGMAS / WEIGHT_SCALE_SIGMAS)
    weight = np.where(counts, 1 / (1 + squared) ** 2, 0.0)
    derivative = np.where(counts, (1 - 3 * squared) / (1 + squared) ** 3, 0.0)
    sandwich_factor = float(derivative.sum() / max(weight.sum(), 1e-300))
    return weight, max(sandwich_factor, MIN_SANDWICH_FACTOR)
