"""The part of the image that receives light: the whole image, the image circle of a fisheye, or a masked part."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, FloatArray, size_of
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.photometry.geometry import normalised, pixel_grid, pixels_of
from ospc.settings.grey_values import (
    LIT_QUANTILE,
    MAX_SURROUND_SHARE,
    MIN_CIRCLE_FRAMES,
    MIN_LIT_8_BIT,
    MIN_SURROUND_AREA,
    MIN_SURROUND_CORNERS,
    SURROUND_MARGIN_PX,
    WHOLE_IMAGE_RADIUS,
)

_CORNERS = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)])
"""Directions to the four corners."""


@dataclass
class ImageCircle:
    """Keeps the largest grey level of every pixel.

    A pixel that shows a dark part of the scene becomes bright sooner or later; one outside the image circle never
    does. A region that stays dark and reaches the corners is treated as the surround of a fisheye image.
    """

    brightest: npt.NDArray[np.uint8] | None = None
    """Largest grey level of each pixel at the size used for registration, 8 bit, shape (h, w)."""
    frames: int = 0
    """Number of frames observed."""
    allowed: BoolArray | None = None
    """Which pixels may be used, in the same size; None for all."""

    def observe(self, frame: PreprocessedFrame, mask: BoolArray | None) -> None:
        """Add a frame; the mask marks its usable pixels, shape (height, width), None for all."""
        self.frames += 1
        # The small image of a frame never changes, so it need not be copied.
        self.brightest = frame.small if self.brightest is None else np.maximum(self.brightest, frame.small)
        if mask is not None and self.allowed is None:
            height, width = frame.small.shape
            self.allowed = cv2.resize(mask.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0

    def surround(self) -> BoolArray | None:
        """Return which pixels never receive light, in the small size, shape (h, w); None if all do."""
        if self.brightest is None or self.frames < MIN_CIRCLE_FRAMES:
            return None
        lit = float(np.quantile(self.brightest, LIT_QUANTILE))
        if lit < MIN_LIT_8_BIT:
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
        """Return the radius of the usable part, in half diagonals about the image centre; at most 1."""
        surround = self.surround()
        if self.brightest is None or (surround is None and self.allowed is None):
            return 1.0
        height, width = self.brightest.shape
        place = normalised(pixel_grid((width, height)), (width, height))
        lit = np.ones((height, width), dtype=bool) if surround is None else ~surround
        radius = np.where(lit, np.linalg.norm(place, axis=-1), 0.0)
        # A decentred image circle may include one corner, which alone does not determine the radius.
        reached = float(np.median([radius[(place * corner >= 0).all(axis=-1)].max() for corner in _CORNERS]))
        if self.allowed is not None:
            # A mask may hide any side: the vignette is needed up to the outermost usable pixel.
            reached = min(reached, float(radius[self.allowed].max(initial=0.0)))
        return reached if 0 < reached < WHOLE_IMAGE_RADIUS else 1.0

    def receives_light(self, position: FloatArray) -> BoolArray | None:
        """Return which positions, in half diagonals, are outside the surround, (n, 2) -> (n,); None without one."""
        surround = self.surround()
        if surround is None:
            return None
        size = size_of(surround)
        x, y = np.clip(np.rint(pixels_of(position, size)).astype(np.int64), 0, np.array(size) - 1).T
        return np.asarray(~surround[y, x])
