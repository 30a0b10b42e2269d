"""The motion of most of the view between two frames: where each pixel of the first image is in the second."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.polynomial.polynomial import polygrid2d, polyvander2d

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image, ImageSize
from ospc.correspondence.thumbnail_registration import pixel_places, values_at
from ospc.settings.grey_values import MIN_SURROUND_CORNERS
from ospc.settings.registration import (
    CURVED_MOTION_DISTRUST,
    CURVED_MOTION_MIN_GAIN,
    CURVED_MOTION_ORDER,
    CURVED_MOTION_STEPS,
    HOMOGRAPHY_INLIER_PX,
    HOMOGRAPHY_MIN_INLIERS,
    HOMOGRAPHY_MIN_ROWS,
    HOMOGRAPHY_SPACING_PX,
    MIN_OVERLAP,
)


@dataclass(frozen=True)
class Homography:
    """The motion of a plane, or of any scene if the camera only turns, seen through a lens without distortion."""

    matrix: FloatArray
    """Shape (3, 3)."""

    def at(self, places: Float32Array) -> Float32Array:
        """Return where places (x, y) of the first image are in the second, in pixels, (h, w, 2) -> (h, w, 2)."""
        return np.asarray(cv2.perspectiveTransform(places, self.matrix))

    def warped(self, image: Image) -> Image:
        """Return the second image as the first view would show it; its border is repeated beyond it."""
        inverse, size = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, image.shape[::-1]
        return np.asarray(
            cv2.warpPerspective(image, self.matrix, size, flags=inverse, borderMode=cv2.BORDER_REPLICATE)
        )


@dataclass(frozen=True)
class CurvedMotion:
    """Displacements that vary smoothly, as in a fisheye that turns: straight lines of the scene bend."""

    displacement: Float32Array
    """Displacement (x, y) of each pixel, shape (h, w, 2)."""

    def at(self, places: Float32Array) -> Float32Array:
        """Return where places (x, y) of the first image are in the second, in pixels, (h, w, 2) -> (h, w, 2)."""
        return np.asarray(places + values_at(self.displacement, places))

    def warped(self, image: Image) -> Image:
        """Return the second image as the first view would show it; its border is repeated beyond it."""
        there = pixel_places(image.shape[::-1]) + self.displacement
        return np.asarray(cv2.remap(image, there, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


ViewMotion: TypeAlias = Homography | CurvedMotion
"""A mapping from places in the first image to those in the second."""


def view_motion(displacement: Float32Array, shown: BoolArray | None) -> ViewMotion | None:
    """Return the motion that explains most displacements, (h, w, 2); None if none explains enough.

    Pixels that do not show the scene, shape (h, w), do not move with it: they count neither for nor against. If they
    include the corners, the image may be that of a fisheye: its motion is curved if that explains far more than a
    homography. Curves would also fit the parallax of other lenses, as in a car whose bonnet is in the view.
    """
    sample = _Lattice.of(displacement, shown)
    matrix, support = sample.homography()
    best: ViewMotion | None = None if matrix is None else Homography(matrix)
    if shown is not None and np.count_nonzero(~shown[[0, 0, -1, -1], [0, -1, 0, -1]]) >= MIN_SURROUND_CORNERS:
        curved, curved_support = sample.curved()
        if curved_support > CURVED_MOTION_MIN_GAIN * support:
            best, support = curved, curved_support
    return best if support >= sample.fewest else None


def homography(displacement: Float32Array, shown: BoolArray | None) -> FloatArray | None:
    """Return the homography that explains most displacements, (h, w, 2) -> (3, 3); None if none explains enough."""
    sample = _Lattice.of(displacement, shown)
    found, support = sample.homography()
    return found if support >= sample.fewest else None


@dataclass(frozen=True)
class _Lattice:
    """Displacements on a lattice of places that show the scene."""

    size: ImageSize
    places: Float32Array
    there: Float32Array
    """Those that both views show, and where they are in the second, shape (n, 2) each."""
    fewest: float
    """Number of places that must support a motion."""

    @classmethod
    def of(cls, displacement: Float32Array, shown: BoolArray | None) -> _Lattice:
        """Return the displacements at some pixels, (h, w, 2), of those that show the scene, (h, w)."""
        height, width = displacement.shape[:2]
        side = min(height, width) if shown is None else min(height, width, math.isqrt(np.count_nonzero(shown)))
        step = max(1, min(HOMOGRAPHY_SPACING_PX, side // HOMOGRAPHY_MIN_ROWS))
        lattice = (slice(step // 2, None, step),) * 2
        places = pixel_places((width, height))[lattice].reshape(-1, 2)
        there = places + displacement[lattice].reshape(-1, 2)
        if shown is not None:
            seen = shown[lattice].ravel()
            places, there = places[seen], there[seen]
        inside = np.all((there >= 0) & (there <= (width - 1, height - 1)), axis=1)
        if shown is not None:
            inside &= values_at(shown.astype(np.float32), there) > 0.5
        fewest = max(MIN_OVERLAP * len(places), HOMOGRAPHY_MIN_INLIERS)
        return cls((width, height), places[inside], there[inside], fewest)

    def homography(self) -> tuple[FloatArray | None, int]:
        """Return the homography with most support, and its support."""
        if len(self.places) < self.fewest:
            return None, 0
        found, supports = cv2.findHomography(self.places, self.there, cv2.USAC_FAST, HOMOGRAPHY_INLIER_PX)
        return (None, 0) if found is None else (np.asarray(found), int(np.count_nonzero(supports)))

    def curved(self) -> tuple[CurvedMotion | None, int]:
        """Return displacements that are polynomials of the place, fitted robustly, and their support."""
        if len(self.places) < self.fewest:
            return None, 0
        across, down = (np.linspace(-1, 1, side) for side in self.size)
        x, y = self.places.astype(np.int64).T
        order = CURVED_MOTION_ORDER
        used = np.add.outer(np.arange(order + 1), np.arange(order + 1)).ravel() <= order
        terms = polyvander2d(across[x], down[y], (order, order))[:, used]
        found, errors = _robust_fit(terms, (self.there - self.places).astype(np.float64))
        coefficients = np.zeros((len(used), 2))
        coefficients[used] = found
        everywhere = polygrid2d(across, down, coefficients.reshape(order + 1, order + 1, 2))
        motion = CurvedMotion(np.ascontiguousarray(everywhere.T, dtype=np.float32))
        return motion, int(np.count_nonzero(errors < HOMOGRAPHY_INLIER_PX))


def _robust_fit(terms: FloatArray, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of displacements, (n, k) and (n, 2) -> (k, 2), and the errors that remain, (n,)."""
    weight = np.ones((len(terms), 1))
    for _ in range(CURVED_MOTION_STEPS):
        found = np.asarray(np.linalg.lstsq(terms * weight, moved * weight, rcond=None)[0])
        errors = np.asarray(np.linalg.norm(moved - terms @ found, axis=1))
        weight[:, 0] = (1 + (errors / HOMOGRAPHY_INLIER_PX) ** 2) ** -CURVED_MOTION_DISTRUST
    return found, errors
