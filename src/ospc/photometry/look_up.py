"""Tables of values by grey value, applied to every pixel of an image."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import Image

_FIRST_FOR_16_BIT = 5
"""First release of OpenCV with tables for 16-bit pixels."""


def look_up(pixels: Image, tables: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Return the table entry of every pixel; ``tables`` has shape (greys of the type, channels or 1)."""
    by_opencv = pixels.dtype == np.uint8 or int(cv2.__version__.partition(".")[0]) >= _FIRST_FOR_16_BIT
    read = cv2.LUT if by_opencv else _look_up_16_bit
    return np.asarray(read(pixels, np.ascontiguousarray(tables[None])))


def _look_up_16_bit(pixels: Image, tables: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    columns = np.ascontiguousarray(tables[0].T)
    if len(columns) == 1:
        return np.asarray(columns[0].take(pixels, mode="clip"))
    found = [column.take(pixels[..., channel], mode="clip") for channel, column in enumerate(columns)]
    return np.stack(found, axis=-1)
