"""Direct image alignment: the motion for which points of one image have the same brightness in another."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ospc.arrays import Float32Array, FloatArray
from ospc.numerics.robust import huber_weights, robust_scale

LEVELS = 4
"""Levels of the image pyramid, each half as large as the one below."""
_ITERATIONS, _SETTLED = 12, 1e-6
"""Most steps per level, and the change that counts as converged on the finest level."""
_HUBER, _AGREEING_SIGMAS = 1.345, 3
"""Huber's tuning constant, 95 % efficient for normal residuals, and largest residual of an inlier in σ."""
_NEAR_M, _FEWEST = 0.05, 20
"""Depth below which points count as behind the camera, and visible points that a step needs."""
_GRADIENT = 0.1
"""Gradient, in brightness per pixel, at which a residual has half weight, because position errors dominate there."""


def pose_of(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the homogeneous matrix of X ↦ R·X + t, shape (4, 4)."""
    return np.block([[rotation, translation[:, None]], [np.zeros(3), 1.0]])


def moved(pose: FloatArray, points: FloatArray) -> FloatArray:
    """Return points transformed by a pose, shape (n, 3)."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


@dataclass(frozen=True)
class Brightness:
    """An image pyramid: brightness and its derivatives along x and y, shape (height, width, 3), finest first."""

    levels: tuple[Float32Array, ...]

    @classmethod
    def of(cls, image: Float32Array) -> Brightness:
        """Build the pyramid."""
        found = []
        for _ in range(LEVELS):
            smooth = cv2.GaussianBlur(image, (0, 0), 0.8)
            dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
            dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
            found.append(np.dstack([smooth, dx, dy]))
            image = cv2.resize(image, (image.shape[1] // 2, image.shape[0] // 2), interpolation=cv2.INTER_AREA)
        return cls(tuple(found))

    def at(self, level: int, points: FloatArray) -> FloatArray:
        """Return brightness and derivatives at pixels of level 0, shape (n, 2) -> (n, 3); NaN outside."""
        places = ((points + 0.5) / 2**level - 0.5).astype(np.float32).reshape(-1, 1, 2)
        outside = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": (np.nan, np.nan, np.nan)}
        sampled = cv2.remap(self.levels[level], places, None, cv2.INTER_LINEAR, **outside)
        return np.asarray(sampled.reshape(-1, 3), dtype=np.float64)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera: focal length in pixels and principal point, shape (2,)."""

    focal_px: float
    centre_px: FloatArray

    def lift(self, points: FloatArray, depth_m: FloatArray) -> FloatArray:
        """Return points in space, shape (n, 2), (n,) -> (n, 3)."""
        return np.column_stack([(points - self.centre_px) / self.focal_px, np.ones(len(points))]) * depth_m[:, None]

    def project(self, points_m: FloatArray) -> FloatArray:
        """Return pixels, shape (n, 3) -> (n, 2); far outside the image for points behind the camera."""
        z = points_m[:, 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = self.focal_px * points_m[:, :2] / z + self.centre_px
        return np.where(z > _NEAR_M, pixels, -1e6)


@dataclass(frozen=True)
class Aligned:
    """A motion, shape (4, 4), the share of points that are visible inliers, and the median displacement in pixels."""

    motion: FloatArray
    agreeing: float
    moved_px: float


def align(
    points_m: FloatArray, reference: FloatArray, image: Brightness, camera: Camera, start: FloatArray, *, affine: bool
) -> Aligned:
    """Return the motion from a camera with known points to the camera of another image.

    Gauss-Newton, coarse to fine, on the Huber loss of brightness differences. The points, shape (n, 3), are in the
    frame of the first camera; ``reference`` is their brightness on each level, shape (levels, n). With ``affine``,
    the brightness of the second image is a·I + b, and a and b are estimated as well.
    """
    motion, gain, agreeing = start, np.zeros(2), 0.0
    for level in reversed(range(LEVELS)):
        for _ in range(_ITERATIONS):
            moved_m = moved(motion, points_m)
            sampled = image.at(level, camera.project(moved_m))
            step = _step(moved_m, sampled, reference[level], camera.focal_px / 2**level, gain, affine=affine)
            if step is None:
                break
            change, agreeing = step
            motion = pose_of(Rotation.from_rotvec(change[3:6]).as_matrix(), change[:3]) @ motion
            gain = gain + change[6:8] if affine else gain
            if np.max(np.abs(change[:6])) < _SETTLED * 4**level:
                break
    # Re-orthogonalise: rounding errors of rotation products would accumulate in the next initial motion.
    left, _, right = np.linalg.svd(motion[:3, :3])
    motion = pose_of(left @ right, motion[:3, 3])
    moved_px = camera.project(moved(motion, points_m)) - camera.project(points_m)
    return Aligned(motion, agreeing, float(np.median(np.linalg.norm(moved_px, axis=1))))


def _step(
    points_m: FloatArray,
    sampled: FloatArray,
    reference: FloatArray,
    focal_px: float,
    gain: FloatArray,
    *,
    affine: bool,
) -> tuple[FloatArray, float] | None:
    """Return a Gauss-Newton step (translation, rotation, ln a, b) and the share of inliers; None with few points."""
    # The points are in the frame of the second camera, which samples their brightness and its derivatives.
    good = np.isfinite(sampled).all(axis=1) & np.isfinite(reference)
    if np.count_nonzero(good) < _FEWEST:
        return None
    x, y, z = points_m[good].T
    value, dx, dy = sampled[good].T
    scaled = np.exp(gain[0]) * reference[good]
    residual = value - scaled - gain[1]
    along = np.column_stack([dx * focal_px / z, dy * focal_px / z, -focal_px * (dx * x + dy * y) / z**2])
    jacobian = np.column_stack([along, np.cross(points_m[good], along)])
    if affine:
        jacobian = np.column_stack([jacobian, -scaled, -np.ones_like(scaled)])
    sigma = robust_scale(residual) + 1e-6
    weight = huber_weights(residual, _HUBER * sigma)
    weight *= _GRADIENT**2 / (_GRADIENT**2 + dx**2 + dy**2)
    normal = (jacobian * weight[:, None]).T @ jacobian
    normal[np.diag_indices_from(normal)] *= 1 + 1e-6
    change = np.linalg.lstsq(normal, -jacobian.T @ (weight * residual), rcond=None)[0]
    return np.asarray(change), float(np.count_nonzero(np.abs(residual) < _AGREEING_SIGMAS * sigma) / len(points_m))
