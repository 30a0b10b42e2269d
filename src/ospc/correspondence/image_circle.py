"""The part of the image that receives light: all of it, the image circle of a fisheye, or what a mask leaves."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, FloatArray
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.photometry.geometry import normalised, pixel_grid

_LEAST_LOOKS = 8
"""Fewest frames looked at before a dark place counts as surround: in a single frame the scene itself may be dark."""

_LIT_QUANTILE = 0.9
_LIT = 60
"""Grey level, of 255, that the brightest tenth of the image must reach: in dark recordings all places look alike."""

_DARK_SHARE = 0.1
"""Grey level of the surround over that of this brightest tenth: a little stray light reaches it. A higher limit would
take dark parts of the scene for it."""

_LEAST_SHARE = 0.01
"""Smallest part of the image that is taken for a surround: less is strong vignetting in the very corners."""

_FEWEST_CORNERS = 3
"""Corners that the surround must reach: an image circle may be off centre and leave one, a dark wall reaches two."""

_MARGIN_PX = 3
"""Widening of the surround, in small pixels: the edge of the circle is blurred, and light falls off steeply there."""

_CORNERS = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)])
"""Directions to the four corners."""

_WHOLE = 0.97
"""An image of which something is usable so far out counts as usable up to its corners."""


@dataclass
class ImageCircle:
    """Remembers the brightest that every place of the image ever was.

    A place that a dark part of the scene covers is lit sooner or later; one outside the image circle never is. What
    stays dark and reaches the corners is taken for the surround of a fisheye's image.
    """

    brightest: npt.NDArray[np.uint8] | None = None
    """Largest grey level of each place in the size at which frames are registered, 8 bit, shape (h, w)."""
    looks: int = 0
    """Number of frames looked at."""
    allowed: BoolArray | None = None
    """Where pixels may be used, in the same size; None for everywhere."""

    def observe(self, frame: PreprocessedFrame, mask: BoolArray | None) -> None:
        """Look at a frame; the mask says where its pixels may be used, shape (height, width), None for everywhere."""
        self.looks += 1
        # Nobody else changes the small image of a frame, so that it need not be copied.
        self.brightest = frame.small if self.brightest is None else np.maximum(self.brightest, frame.small)
        if mask is not None and self.allowed is None:
            height, width = frame.small.shape
            self.allowed = cv2.resize(mask.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0

    def surround(self) -> BoolArray | None:
        """Return where the image never sees light, in the small size, shape (h, w); None where it does everywhere."""
        if self.brightest is None or self.looks < _LEAST_LOOKS:
            return None
        lit = float(np.quantile(self.brightest, _LIT_QUANTILE))
        if lit < _LIT:
            return None
        dark = (self.brightest <= _DARK_SHARE * lit).astype(np.uint8)
        _, label = cv2.connectedComponents(dark)
        corners = label[[0, 0, -1, -1], [0, -1, 0, -1]]
        outside = np.isin(label, corners[corners > 0])
        if np.count_nonzero(corners) < _FEWEST_CORNERS or outside.mean() < _LEAST_SHARE:
            return None
        side = 2 * _MARGIN_PX + 1
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
        return reached if 0 < reached < _WHOLE else 1.0

    def sees(self, position: FloatArray) -> BoolArray | None:
        """Return which positions, in half diagonals, (n, 2) -> (n,), are not in the surround; None without one."""
        surround = self.surround()
        if surround is None:
            return None
        last = np.array(surround.shape[::-1]) - 1
        x, y = np.clip(np.rint(position * np.hypot(*last) / 2 + last / 2).astype(np.int64), 0, last).T
        return np.asarray(~surround[y, x])
