"""Tables of values by grey value, applied to every pixel of an image."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import Image


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
    columns = np.ascontiguousarray(tables[0].T)
    if len(columns) == 1:
        return np.asarray(columns[0].take(pixels, mode="clip"))
    found = [column.take(pixels[..., channel], mode="clip") for channel, column in enumerate(columns)]
    return np.stack(found, axis=-1)
