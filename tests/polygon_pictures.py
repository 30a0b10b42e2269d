"""Small synthetic photographs of uniform surfaces, with known response and vignette."""

from __future__ import annotations

import cv2
import numpy as np

from ospc.arrays import Image, ImageSize
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette

FINER = 4
"""Oversampling factor of the drawn polygons, so that pixels on their edges mix both sides."""


def picture(
    response: Response,
    *,
    vignette: Vignette | None = None,
    size: ImageSize = (320, 240),
    polygons: int = 90,
    seed: int = 0,
) -> Image:
    """Return a photograph of random coloured polygons, shape (height, width, 3), uint8."""
    random = np.random.default_rng(seed)
    drawn = np.full((size[1] * FINER, size[0] * FINER, 3), 0.3, np.float32)
    for _ in range(polygons):
        angles = np.sort(random.uniform(0, 2 * np.pi, random.integers(3, 6)))
        circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        corners = FINER * (random.uniform(0, size) + random.uniform(20, 60) * circle)
        colour = np.exp(random.uniform(np.log(0.01), np.log(0.95), 3))
        cv2.fillPoly(drawn, [corners.astype(np.int32)], colour.tolist())
    light = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA)
    if vignette is not None:
        light *= vignette.image()[:, :, None]
    return np.rint(255 * response(light)).astype(np.uint8)
