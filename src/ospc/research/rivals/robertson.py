"""Robertson, Borman and Stevenson, "Estimation-theoretic approach to dynamic range enhancement …", 2003.

OpenCV's implementation. g has 256 free values. Minimises Σ w(M) (g(Mᵢₚ) − tᵢEₚ)² for g and the irradiances E in turn,
with a weight w that falls towards both ends like a normal distribution.
"""

from __future__ import annotations

import cv2
import numpy as np

from ospc.photometry.response import Response
from ospc.research.rivals.camera_at_rest import LEVELS, ExposureSeries, response_of_values

_TURNS = 60


def robertson(series: ExposureSeries) -> Response:
    """Return the response."""
    images = [np.ascontiguousarray(image[:, :, None].repeat(3, axis=2)) for image in series.images]
    method = cv2.createCalibrateRobertson(_TURNS, 0.0)
    found = method.process(images, series.relative_exposures.astype(np.float32))
    return response_of_values(np.asarray(found, dtype=np.float64).reshape(LEVELS, -1)[:, 0], "robertson")
