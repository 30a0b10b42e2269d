"""Pixel coordinates relative to the image centre."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ospc.arrays import Float32Array, FloatArray, ImageSize, IntArray
from ospc.errors import FormatError, OspcError

_BAND_PIXELS = 2**15
"""Pixels evaluated at a time: few enough to stay in the cache and need little memory."""
MOST_PIXELS = 2**27
"""Images with more pixels are rejected: twice the largest common sensor."""

_ASPECT_TOLERANCE = 0.01
"""Largest difference between logarithms of aspect ratios for the same field of view; it allows for rounding."""


def image_size(width: float, height: float, kind: type[OspcError] = FormatError) -> ImageSize:
    """Return a size after checking it, in whole pixels; an error of this kind if an image cannot have this size."""
    if not (min(width, height) >= 2 and width * height <= MOST_PIXELS):
        raise kind(
            f"{width:g}×{height:g} is not an image size; sides have at least 2 pixels, images at most {MOST_PIXELS}"
        )
    return int(width), int(height)


def half_diagonal(size: ImageSize) -> float:
    """Return the distance in pixels from the image centre to the centre of a corner pixel."""
    return float(np.hypot(size[0] - 1, size[1] - 1) / 2)


def normalised(points: FloatArray, size: ImageSize) -> FloatArray:
    """Return pixel coordinates (x, y) relative to the image centre in half diagonals, shape (..., 2) -> (..., 2).

    The centre of the first pixel is (0, 0). The norm of the result is the radius R of the paper, 1 at the corner.
    """
    centre = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    return np.asarray((np.asarray(points, dtype=np.float64) - centre) / half_diagonal(size), dtype=np.float64)


def pixels_of(position: FloatArray, size: ImageSize) -> FloatArray:
    """Return the pixel coordinates of positions relative to the image centre in half diagonals, (..., 2) -> (..., 2).

    It is the inverse of :func:`normalised`.
    """
    return np.asarray(position * half_diagonal(size) + (np.array(size) - 1) / 2)


def along_diagonals(radius: npt.ArrayLike, size: ImageSize) -> FloatArray:
    """Return the positions at radii along the four half diagonals of an image, shape (...) -> (..., 4, 2).

    Radii and positions are relative to the image centre, in half diagonals: at radius 1 are the corners.
    """
    corners = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) * (np.array(size) - 1) / 2 / half_diagonal(size)
    return np.asarray(np.asarray(radius, dtype=np.float64)[..., None, None] * corners)


def cells_of(position: FloatArray, cells: tuple[int, int]) -> IntArray:
    """Return the number of the image cell of each position, shape (n, 2) -> (n,).

    ``cells`` is the number of cells across and down. They divide the rectangle about the image centre that just
    contains all positions.
    """
    extent = np.maximum(np.abs(position).max(axis=0), np.finfo(np.float64).tiny)
    place = np.clip((position / extent + 1) / 2 * cells, 0, np.array(cells) - 1)
    return np.asarray(np.ravel_multi_index(tuple(place.astype(np.int64).T), cells))


def image_of(function: Callable[[FloatArray, FloatArray], FloatArray], size: ImageSize) -> Float32Array:
    """Return the value of a function at every pixel, shape (height, width).

    It is called for a few rows at a time with positions relative to the image centre in half diagonals, x of shape
    (width,) and y of shape (rows, 1), and returns values of shape (rows, width).
    """
    width, height = size
    diagonal = normalised(np.stack([np.arange(max(size))] * 2, axis=1).astype(np.float64), size)
    x, y = diagonal[:width, 0], diagonal[:height, 1, None]
    image = np.empty((height, width), np.float32)
    rows = max(1, _BAND_PIXELS // width)
    for top in range(0, height, rows):
        image[top : top + rows] = function(x, y[top : top + rows])
    return image


def pixel_grid(size: ImageSize) -> FloatArray:
    """Return the coordinates of all pixels, shape (height, width, 2)."""
    x, y = np.meshgrid(np.arange(size[0], dtype=np.float64), np.arange(size[1], dtype=np.float64))
    return np.stack([x, y], axis=-1)


def same_aspect(first: ImageSize, second: ImageSize) -> bool:
    """Return whether images of two sizes can have the same field of view."""
    return abs(math.log(first[0] * second[1] / (first[1] * second[0]))) <= _ASPECT_TOLERANCE
