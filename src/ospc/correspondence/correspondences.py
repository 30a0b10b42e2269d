"""Scene points seen in two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import BoolArray, FloatArray, ImageSize
from ospc.photometry.geometry import normalised


@dataclass(frozen=True)
class Correspondences:
    """The same scene points in two frames, with their grey levels.

    Attributes
    ----------
    frames
        Indices of the two frames.
    exposure_ratio
        k = e₀/e₁ according to the metadata.
    size
        Width and height of the frames in pixels.
    points0, points1
        Pixel coordinates (x, y) in the two frames, shape (n, 2).
    grey0, grey1
        Grey levels in [0, 1], shape (n,).
    """

    frames: tuple[int, int]
    exposure_ratio: float
    size: ImageSize
    points0: FloatArray
    points1: FloatArray
    grey0: FloatArray
    grey1: FloatArray

    def __len__(self) -> int:
        """Return the number of scene points."""
        return len(self.grey0)

    def select(self, mask: BoolArray) -> Correspondences:
        """Return those where the mask, shape (n,), is true."""
        return Correspondences(
            self.frames,
            self.exposure_ratio,
            self.size,
            self.points0[mask],
            self.points1[mask],
            self.grey0[mask],
            self.grey1[mask],
        )

    @property
    def radius0(self) -> FloatArray:
        """Distance from the image centre in the first frame, 1 at the corner, shape (n,)."""
        return np.asarray(np.linalg.norm(normalised(self.points0, self.size), axis=-1))

    @property
    def radius1(self) -> FloatArray:
        """Distance from the image centre in the second frame, 1 at the corner, shape (n,)."""
        return np.asarray(np.linalg.norm(normalised(self.points1, self.size), axis=-1))

    @property
    def radial_displacement(self) -> FloatArray:
        """|R₀ − R₁|, shape (n,)."""
        return np.abs(self.radius0 - self.radius1)
