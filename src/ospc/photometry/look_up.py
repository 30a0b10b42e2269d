"""Tables of values by grey value, applied to every pixel of an image."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import Image

_ROWS_AT_ONCE = 16
"""Rows looked up at a time: the 64-bit indices of 16 rows stay in the processor cache."""


def look_up(pixels: Image, tables: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Return the table entry of every pixel; ``tables`` has shape (greys of the type, channels or 1)."""
    read = cv2.LUT if pixels.dtype == np.uint8 or _opencv_reads_16_bit_tables() else _look_up_16_bit
    return np.asarray(read(pixels, np.ascontiguousarray(tables[None])))


@cache
def _opencv_reads_16_bit_tables() -> bool:
    """Return whether this OpenCV supports tables for 16-bit pixels, as releases from 5.0 do."""
    try:
        cv2.LUT(np.zeros((1, 1), np.uint16), np.zeros((1, 65536), np.float32))
    except cv2.error:
        return False
    return True


def _look_up_16_bit(pixels: Image, tables: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    found = np.empty(pixels.shape, tables.dtype)
    for channel in np.ndindex(pixels.shape[2:]):
        column = np.ascontiguousarray(tables[0, :, channel[0] if channel and tables.shape[2] > 1 else 0])
        source, target = pixels[(..., *channel)], found[(..., *channel)]
        # NumPy converts the indices to 64 bits; those of a few rows stay in the cache.
        for row in range(0, pixels.shape[0], _ROWS_AT_ONCE):
            part = slice(row, row + _ROWS_AT_ONCE)
            target[part] = np.take(column, source[part], mode="clip")
    return found
