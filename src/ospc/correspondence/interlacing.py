"""Detection of interlaced video, in which every other row shows a different moment."""

from __future__ import annotations

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.settings.grey_values import COMPARED_COLUMNS_PX, LEAST_ROW_VARIANCE, MIN_INTERLACED_ALTERNATION


def row_alternation(image: Image, max_grey: int) -> float:
    """Return how much rows differ from both neighbours in the same direction, from -1 to 1.

    It is minus the correlation of successive differences between rows, in the middle of the image: 1 if rows
    alternate between two images, 1/2 for noise and single lines, and usually below 0 for scenes. If columns
    alternate, too, as in a Bayer mosaic, it is 0.
    """
    rows = _alternation(image, max_grey)
    if rows > MIN_INTERLACED_ALTERNATION and _alternation(image.T, max_grey) > MIN_INTERLACED_ALTERNATION:
        return 0.0
    return rows


def _alternation(image: Image, max_grey: int) -> float:
    """Return minus the correlation of successive differences between rows."""
    height, width = (side // 2 for side in image.shape)
    columns = width // COMPARED_COLUMNS_PX
    if height < 3 or not columns:
        return 0.0
    top, left = height // 2, width // 2
    middle = image[top : top + height, left : left + columns * COMPARED_COLUMNS_PX].astype(np.float32)
    rows = cv2.resize(middle, (columns, height), interpolation=cv2.INTER_AREA) / np.float32(max_grey)
    # Differences of whole rows are readout noise of the sensor.
    rows -= rows.mean(axis=1, keepdims=True)
    step = np.diff(rows, axis=0)
    above, below = step[:-1], step[1:]
    variance = float(np.mean(above**2) + np.mean(below**2)) / 2
    return -float(np.mean(above * below)) / (variance + LEAST_ROW_VARIANCE)
