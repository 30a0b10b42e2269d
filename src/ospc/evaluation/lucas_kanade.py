"""Track points between frames and detect lost ones (Lucas and Kanade 1981; Bouguet 2000)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import BoolArray, FloatArray, Image
from ospc.settings.evaluation import (
    MAX_MISMATCH,
    MAX_RETURN_PX,
    MIN_CONTRAST,
    TRACKING_LEVELS,
    WINDOW_PX,
)

LOSSES = ("gave up", "came back elsewhere", "looks different")
"""Causes of loss: the Lucas-Kanade method itself fails; backward tracking does not return to the start; the windows
differ too much."""


@dataclass(frozen=True)
class Step:
    """Points in the next frame: pixel coordinates, shape (n, 2), and which are lost by each of :data:`LOSSES`.

    Each column of ``losses``, shape (3, n), has at most one true value.
    """

    places: FloatArray
    losses: BoolArray

    @property
    def followed(self) -> BoolArray:
        """Which points are not lost, shape (n,)."""
        return np.asarray(~self.losses.any(axis=0))


def follow(before: Image, after: Image, places: FloatArray) -> Step:
    """Track points, shape (n, 2), from one 8-bit image to the next."""
    if len(places) == 0:
        return Step(places, np.zeros((len(LOSSES), 0), np.bool_))
    there, found = _flow(before, after, places)
    back, found_back = _flow(after, before, there)
    gave_up = ~(found & found_back)
    elsewhere = ~gave_up & (np.linalg.norm(back - places, axis=1) > MAX_RETURN_PX)
    first, second = windows(before, places), windows(after, there)
    mismatch = in_contrasts(np.abs(first - second).mean(axis=1), first, second)
    different = ~gave_up & ~elsewhere & (mismatch > MAX_MISMATCH)
    return Step(there, np.stack([gave_up, elsewhere, different]))


def windows(image: Image, places: FloatArray, side_px: int = WINDOW_PX) -> FloatArray:
    """Return the bilinearly interpolated windows around points, shape (n, 2) -> (n, side_px²)."""
    reach = np.arange(side_px, dtype=np.float64) - side_px // 2
    y, x = (grid.ravel() for grid in np.meshgrid(reach, reach, indexing="ij"))
    at = [(places[:, i, None] + offset).astype(np.float32) for i, offset in enumerate((x, y))]
    values = cv2.remap(image.astype(np.float32), *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float64)


def in_contrasts(change: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Divide changes, shape (n,), by the mean absolute deviation within two windows, shape (n, pixels) each."""
    deviations = [np.abs(w - w.mean(axis=1, keepdims=True)).mean(axis=1) for w in (first, second)]
    return np.asarray(change / np.maximum(np.mean(deviations, axis=0), MIN_CONTRAST))


def _flow(before: Image, after: Image, places: FloatArray) -> tuple[FloatArray, BoolArray]:
    points = places.astype(np.float32).reshape(-1, 1, 2)
    window = (WINDOW_PX, WINDOW_PX)
    there, status, _ = cv2.calcOpticalFlowPyrLK(before, after, points, None, winSize=window, maxLevel=TRACKING_LEVELS)
    return np.asarray(there, dtype=np.float64).reshape(-1, 2), np.asarray(status.ravel() == 1)
