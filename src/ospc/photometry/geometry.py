"""Pixel coordinates relative to the image centre."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError

MOST_PIXELS = 2**27
"""Images with more pixels are refused: twice the largest sensor in ordinary use."""


def image_size(width: float, height: float) -> ImageSize:
    """Return the width and height that a file states, in whole pixels.

    Raises
    ------
    FormatError
        If an image cannot have this size.
    """
    if not (min(width, height) >= 2 and width * height <= MOST_PIXELS):
        raise FormatError(f"{width:g}x{height:g} is no image size; images have at most {MOST_PIXELS} pixels")
    return int(width), int(height)


def half_diagonal(size: ImageSize) -> float:
    """Return the distance in pixels from the image centre to the centre of a corner pixel."""
    return float(np.hypot(size[0] - 1, size[1] - 1) / 2)


def normalised(points: FloatArray, size: ImageSize) -> FloatArray:
    """Return points relative to the image centre in units of the half diagonal.

    Parameters
    ----------
    points
        Pixel coordinates (x, y), shape (..., 2); the first pixel's centre is (0, 0).
    size
        Width and height in pixels.

    Returns
    -------
    FloatArray
        Shape (..., 2); the norm of a row is the paper's radius R, 1 at the corner.
    """
    centre = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    return np.asarray((np.asarray(points, dtype=np.float64) - centre) / half_diagonal(size), dtype=np.float64)


def pixel_grid(size: ImageSize) -> FloatArray:
    """Return the coordinates of all pixels, shape (height, width, 2)."""
    x, y = np.meshgrid(np.arange(size[0], dtype=np.float64), np.arange(size[1], dtype=np.float64))
    return np.stack([x, y], axis=-1)
