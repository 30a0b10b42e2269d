"""Track points from one image to another and back with the Lucas-Kanade method (Bouguet 2000)."""

from __future__ import annotations

import cv2
import numpy as np

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image


def track_and_return(
    before: Image, after: Image, places: Float32Array, window_px: int, levels: int
) -> tuple[Float32Array, BoolArray, FloatArray]:
    """Track points, shape (n, 2), n > 0, from one 8-bit image to another and back.

    Return their pixels (x, y) there, shape (n, 2), whether they were tracked there and back, and the distance in
    pixels between the start and the point where they came back, shape (n,). ``levels`` is the number of levels of the
    image pyramid above the image itself.
    """
    there, found = _flow(before, after, places, window_px, levels)
    back, found_back = _flow(after, before, there, window_px, levels)
    return_px = np.linalg.norm(back.astype(np.float64) - places, axis=1)
    return there, found & found_back, np.asarray(return_px)


def _flow(
    before: Image, after: Image, places: Float32Array, window_px: int, levels: int
) -> tuple[Float32Array, BoolArray]:
    window = (window_px, window_px)
    there, status, _ = cv2.calcOpticalFlowPyrLK(before, after, places, None, winSize=window, maxLevel=levels)
    return np.asarray(there, dtype=np.float32), np.asarray(status.ravel() == 1)
