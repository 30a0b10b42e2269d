"""Whether every other row of the images shows another moment, as in interlaced video."""

from __future__ import annotations

import cv2
import numpy as np

from ospc.arrays import Float32Array, Image
from ospc.settings.correspondence import ROW_BLOCK_PX, ROW_CONTRAST_FLOOR


def row_contrast(image: Image, max_grey: int) -> float:
    """Return how much more every other row differs from its neighbours than every other column does.

    It is the ratio of the energies of the highest frequency, in small blocks of the middle of the image. Texture and
    noise have about as much of it in both directions.
    """
    height, width = (side // 2 for side in image.shape)
    if min(height, width) <= 2 * ROW_BLOCK_PX:
        return 1.0
    top, left = height // 2, width // 2
    grey = image[top : top + height, left : left + width].astype(np.float32) / np.float32(max_grey)
    return (_alternation(grey) + ROW_CONTRAST_FLOOR) / (_alternation(grey.T) + ROW_CONTRAST_FLOOR)


def _alternation(grey: Float32Array) -> float:
    """Return the energy of what changes its sign from row to row, and is not the same along a whole row."""
    bend = 2 * grey[1:-1] - grey[:-2] - grey[2:]
    bend[::2] *= -1
    rows, columns = (side // ROW_BLOCK_PX for side in bend.shape)
    whole = np.ascontiguousarray(bend[: rows * ROW_BLOCK_PX, : columns * ROW_BLOCK_PX])
    blocks = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    # Whole rows that differ are noise of the sensor's readout.
    return float(np.var(blocks, axis=1).mean())
