"""The part of the image that receives light: all of it, the image circle of a fisheye, or what a mask leaves."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, FloatArray
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.settings.correspondence import (
    LIT_QUANTILE,
    MAX_SURROUND_SHARE,
    MIN_CIRCLE_FRAMES,
    MIN_LIT_GREY,
    MIN_SURROUND_AREA,
    MIN_SURROUND_CORNERS,
    SURROUND_MARGIN_PX,
    WHOLE_IMAGE_RADIUS,
)

_CORNERS = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)])
"""Directions to the four corners."""


@dataclass
class ImageCircle:
    """Keeps the largest grey level that each place of the image ever had.

    A place that a dark part of the scene covers is lit sooner or later; one outside the image circle never is. What
    stays dark and reaches the corners is taken for the surround of a fisheye's image.
    """

    brightest: npt.NDArray[np.uint8] | None = None
    """Largest grey level of each place in the size at which frames are registered, 8 bit, shape (h, w)."""
    frames: int = 0
    """Number of frames observed."""
    allowed: BoolArray | None = None
    """Where pixels may be used, in the same size; None for everywhere."""

    def observe(self, frame: PreprocessedFrame, mask: BoolArray | None) -> None:
        """Take a frame; the mask says where its pixels may be used, shape (height, width), None for everywhere."""
        self.frames += 1
        # Nobody else changes the small image of a frame, so that it need not be copied.
        self.brightest = frame.small if self.brightest is None else np.maximum(self.brightest, frame.small)
        if mask is not None and self.allowed is None:
            height, width = frame.small.shape
            self.allowed = cv2.resize(mask.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0

    def surround(self) -> BoolArray | None:
        """Return where the image never sees light, in the small size, shape (h, w); None where it does everywhere."""
        if self.brightest is None or self.frames < MIN_CIRCLE_FRAMES:
            return None
        lit = float(np.quantile(self.brightest, LIT_QUANTILE))
        if lit < MIN_LIT_GREY:
            return None
        dark = (self.brightest <= MAX_SURROUND_SHARE * lit).astype(np.uint8)
        _, label = cv2.connectedComponents(dark)
        corners = label[[0, 0, -1, -1], [0, -1, 0, -1]]
        outside = np.isin(label, corners[corners > 0])
        if np.count_nonzero(corners) < MIN_SURROUND_CORNERS or outside.mean() < MIN_SURROUND_AREA:
            return None
        side = 2 * SURROUND_MARGIN_PX + 1
        return np.asarray(cv2.dilate(outside.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)

    def usable_radius(self) -> float:
        """Return the radius, in half diagonals about the image centre, that the usable part reaches; at most 1."""
        surround = self.surround()
        if self.brightest is None or (surround is None and self.allowed is None):
            return 1.0
        height, width = self.brightest.shape
        place = normalised(pixel_grid((width, height)), (width, height))
        lit = np.ones((height, width), dtype=bool) if surround is None else ~surround
        radius = np.where(lit, np.linalg.norm(place, axis=-1), 0.0)
        # An image circle that is off centre may leave one corner: that alone does not determine a radius.
        reached = float(np.median([radius[(place * corner >= 0).all(axis=-1)].max() for corner in _CORNERS]))
        if self.allowed is not None:
            # A mask may hide any side: the vignette is asked for as far out as there are pixels in use.
            reached = min(reached, float(radius[self.allowed].max(initial=0.0)))
        return reached if 0 < reached < WHOLE_IMAGE_RADIUS else 1.0

    def receives_light(self, position: FloatArray) -> BoolArray | None:
        """Return which positions, in half diagonals, are not in the surround, (n, 2) -> (n,); None without one."""
        surround = self.surround()
        if surround is None:
            return None
        last = np.array(surround.shape[::-1]) - 1
        x, y = np.clip(np.rint(position * np.hypot(*last) / 2 + last / 2).astype(np.int64), 0, last).T
        return np.asarray(~surround[y, x])
