"""Tracking of points from frame to frame, and detection of lost ones (Lucas and Kanade 1981; Bouguet 2000)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import BoolArray, FloatArray, Image

LOSSES = ("gave up", "came back elsewhere", "looks different")
"""Causes of loss: the Lucas–Kanade method itself fails; tracking back does not return to the start; the windows
differ too much."""


@dataclass(frozen=True)
class Step:
    """Points in the next frame.

    Attributes
    ----------
    places
        Pixel coordinates, shape (n, 2).
    losses
        Which points are lost by each of :data:`LOSSES`, at most one true in a column; shape (3, n).
    """

    places: FloatArray
    losses: BoolArray

    @property
    def followed(self) -> BoolArray:
        """Which points are not lost, shape (n,)."""
        return np.asarray(~self.losses.any(axis=0))


@dataclass(frozen=True)
class Follower:
    """Tracks points with the pyramidal Lucas–Kanade method.

    Attributes
    ----------
    window_px
        Side of the square window, odd.
    levels
        Pyramid levels above the image itself.
    max_return_px
        Largest forward-backward error: distance between a point and the end of tracking it there and back.
    max_mismatch
        Largest mean absolute difference of the two windows over the mean absolute deviation within them: the share
        of the structure that the match does not explain.
    """

    window_px: int = 21
    levels: int = 3
    max_return_px: float = 1.0
    max_mismatch: float = 0.5

    def step(self, before: Image, after: Image, places: FloatArray) -> Step:
        """Track points from one image to the next.

        Parameters
        ----------
        before, after
            8-bit images, shape (height, width).
        places
            Pixel coordinates in the first, shape (n, 2).
        """
        if len(places) == 0:
            return Step(places, np.zeros((len(LOSSES), 0), np.bool_))
        there, found = self._flow(before, after, places)
        back, found_back = self._flow(after, before, there)
        gave_up = ~(found & found_back)
        elsewhere = ~gave_up & (np.linalg.norm(back - places, axis=1) > self.max_return_px)
        windows = self.windows(before, places), self.windows(after, there)
        mismatch = np.abs(windows[0] - windows[1]).mean(axis=1) / np.maximum(contrast(*windows), 1e-9)
        different = ~gave_up & ~elsewhere & (mismatch > self.max_mismatch)
        return Step(there, np.stack([gave_up, elsewhere, different]))

    def windows(self, image: Image, places: FloatArray) -> FloatArray:
        """Return the values around places, interpolated bilinearly, shape (n, window_px²)."""
        reach = np.arange(self.window_px, dtype=np.float64) - self.window_px // 2
        y, x = (grid.ravel() for grid in np.meshgrid(reach, reach, indexing="ij"))
        at = [(places[:, i, None] + offset).astype(np.float32) for i, offset in enumerate((x, y))]
        values = cv2.remap(image.astype(np.float32), *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(values, dtype=np.float64)

    def _flow(self, before: Image, after: Image, places: FloatArray) -> tuple[FloatArray, BoolArray]:
        points = places.astype(np.float32).reshape(-1, 1, 2)
        side = (self.window_px, self.window_px)
        there, status, _ = cv2.calcOpticalFlowPyrLK(before, after, points, None, winSize=side, maxLevel=self.levels)
        return np.asarray(there, dtype=np.float64).reshape(-1, 2), np.asarray(status.ravel() == 1)


def contrast(*windows: FloatArray) -> FloatArray:
    """Return the mean absolute deviation within windows, mean over the arguments, shape (n, pixels) -> (n,)."""
    deviations = [np.abs(w - w.mean(axis=1, keepdims=True)).mean(axis=1) for w in windows]
    return np.asarray(np.mean(deviations, axis=0))
