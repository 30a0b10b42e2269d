"""Engel, Usenko and Cremers, "A photometrically calibrated benchmark for monocular visual odometry", 2016.

The response of the TUM monocular data set. g has 256 free values. Minimises Σ (g(Mᵢ(x)) − tᵢB(x))² over unsaturated
pixels in turn: g(m) is the mean of tᵢB(x) where Mᵢ(x) = m, and B(x) = Σ tᵢ g(Mᵢ(x)) / Σ tᵢ².
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray
from ospc.photometry.response import Response
from ospc.research.rivals.camera_at_rest import LEVELS, ExposureSeries, response_of_values


def engel_response(series: ExposureSeries, iterations: int = 20) -> Response:
    """Return the response after this number of iterations."""
    t = series.relative_exposures[:, None]
    grey = series.images.reshape(len(series.images), -1)
    used = grey < LEVELS - 1
    weight = np.where(used, t, 0.0)
    square = np.maximum((weight * t).sum(axis=0), 1e-12)
    table: FloatArray = np.arange(LEVELS, dtype=np.float64)
    counts = np.bincount(grey[used], minlength=LEVELS)
    for _ in range(iterations):
        irradiance = (weight * table[grey]).sum(axis=0) / square
        sums = np.bincount(grey[used], weights=(t * irradiance)[used], minlength=LEVELS)
        table = sums / np.maximum(counts, 1)
        table *= (LEVELS - 1) / max(float(table.max()), 1e-12)
    return response_of_values(np.where(counts > 0, table, np.nan), "engel")
