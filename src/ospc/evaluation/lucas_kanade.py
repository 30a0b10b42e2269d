"""Track points between frames and detect lost ones (Lucas and Kanade 1981; Bouguet 2000)."""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray, Image
from ospc.correspondence.point_tracking import track_and_return
from ospc.correspondence.thumbnail_registration import values_at
from ospc.settings.evaluation import MAX_MISMATCH, MAX_RETURN_PX, MIN_CONTRAST, TRACKING_LEVELS, WINDOW_PX

LOSSES = ("tracking failed", "forward-backward error", "different appearance")
"""Causes of loss: the Lucas-Kanade method itself fails; backward tracking does not return to the start; the windows
differ too much."""


def follow(before: Image, after: Image, places: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Track points from one 8-bit image to the next, in pixel coordinates, shape (n, 2).

    Return their places there, and which points are lost by each of :data:`LOSSES`, shape (3, n). Each column has at
    most one true value.
    """
    if len(places) == 0:
        return places, np.zeros((len(LOSSES), 0), np.bool_)
    tracked, found, return_px = track_and_return(before, after, places.astype(np.float32), WINDOW_PX, TRACKING_LEVELS)
    there, gave_up = tracked.astype(np.float64), ~found
    elsewhere = found & (return_px > MAX_RETURN_PX)
    first, second = windows(before, places), windows(after, there)
    mismatch = in_contrasts(np.abs(first - second).mean(axis=1), first, second)
    different = ~gave_up & ~elsewhere & (mismatch > MAX_MISMATCH)
    return there, np.stack([gave_up, elsewhere, different])


def windows(image: Image, places: FloatArray, side_px: int = WINDOW_PX) -> FloatArray:
    """Return the bilinearly interpolated windows around points, shape (n, 2) -> (n, side_px²)."""
    offsets = np.arange(side_px, dtype=np.float32) - side_px // 2
    y, x = (grid.ravel() for grid in np.meshgrid(offsets, offsets, indexing="ij"))
    at = places.astype(np.float32)[:, None] + np.stack([x, y], axis=-1)
    return values_at(image.astype(np.float32), at).astype(np.float64)


def in_contrasts(change: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Divide changes, shape (n,), by the mean absolute deviation within two windows, shape (n, pixels) each."""
    deviations = [np.abs(w - w.mean(axis=1, keepdims=True)).mean(axis=1) for w in (first, second)]
    return np.asarray(change / np.maximum(np.mean(deviations, axis=0), MIN_CONTRAST))
