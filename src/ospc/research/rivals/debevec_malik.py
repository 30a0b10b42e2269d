"""Debevec and Malik, "Recovering high dynamic range radiance maps from photographs", 1997; OpenCV's implementation.

ln g has 256 free values. Minimises Σ w(M)² (ln g(Mᵢₚ) − ln Eₚ − ln tᵢ)² + λ Σ w(M)² (second difference of ln g)²,
linear in all unknowns, with a triangular weight w.
"""

from __future__ import annotations

import cv2
import numpy as np

from ospc.photometry.response import Response
from ospc.research.rivals.camera_at_rest import LEVELS, ExposureSeries, response_of_values

_SMOOTHNESS = 10.0
"""λ, OpenCV's default."""


def debevec_malik(series: ExposureSeries, samples: int = 200) -> Response:
    """Return the response from this number of pixels."""
    chosen = series.sampled(samples)
    columns = [np.ascontiguousarray(row[None, :, None].repeat(3, axis=2)) for row in chosen]
    method = cv2.createCalibrateDebevec(chosen.shape[1], _SMOOTHNESS, False)
    found = method.process(columns, series.relative_exposures.astype(np.float32))
    return response_of_values(np.asarray(found, dtype=np.float64).reshape(LEVELS, -1)[:, 0], "debevec-malik")
