"""The vignette of single images from the symmetry of their radial gradients.

Zheng et al., "Single-image vignetting correction using radial gradient symmetry", 2008. In natural images, the
distribution of the radial gradients ψ of ln I is symmetric about zero; a vignette shifts all gradients at one radius
by the same amount. With B = ln V in rings of one pixel,

    argmin Σ w² |ψ − (B_r − B_{r−1})|² + (2λ N/R)² Σ (B_{r+1} − 2 B_r + B_{r−1})²,    N pixels, R rings

is solved by iteratively reweighted least squares, w = exp(−s₁)(1 − exp(−s₂)), s₁ = |ψ − (B_r − B_{r−1})|,
s₂ = α s₁^(α−1). All numbers are those of the program published by the first author (vignCorrection_nonPara, 2010):
λ 0.3, α 0.6, four iterations, images reduced to a quarter of their size, ln(M + 1) for grey levels up to 255. One
deviation: V never increases outwards.

Images are irradiances, g(M); clipped pixels are excluded.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ospc.arrays import BoolArray, FloatArray, ImageSize, IntArray
from ospc.errors import NotObservableError
from ospc.photometry.geometry import pixel_grid
from ospc.photometry.vignette import PolynomialVignette
from ospc.settings.unknown_exposures import (
    FITTED_RADII,
    MIN_REDUCED_SIDE_PX,
    MIN_RING_RESIDUAL,
    MIN_RING_VIGNETTE,
    RING_OFFSET,
    RING_REDUCTION,
    RING_RIDGE,
    RING_ROUNDS,
    RING_SMOOTHNESS,
    RING_SPARSITY,
)


def radial_gradient_vignette(
    images: Sequence[FloatArray], masks: Sequence[BoolArray] | None = None
) -> PolynomialVignette:
    """Estimate the vignette of images of equal size from the symmetry of their radial gradients.

    The images are irradiances, shape (height, width) each. Masks are true for well-exposed pixels, and default to all
    pixels. NotObservableError if too few pixels are well exposed.
    """
    size = (images[0].shape[1], images[0].shape[0])
    rings, gradients = [], []
    for image, mask in zip(images, masks or [np.ones(image.shape, bool) for image in images], strict=True):
        ring, psi = _radial_gradients(np.log(_reduced(image) + RING_OFFSET))
        # Gradients involve neighbouring pixels.
        exposed = cv2.erode(_reduced(mask), np.ones((3, 3), np.uint8)) > 1 - 1e-6
        kept = exposed & (ring > 0)
        rings.append(ring[kept])
        gradients.append(psi[kept])
    last = int(ring.max())
    # The same smoothness for any number of images.
    bending = (2 * RING_SMOOTHNESS * ring.size / (last + 1)) ** 2 * len(images)
    log_v = _log_attenuation(np.concatenate(rings), np.concatenate(gradients), last, bending)
    return _polynomial(size, np.interp(FITTED_RADII, np.arange(last + 1) / last, log_v))


def _reduced(image: FloatArray | BoolArray) -> FloatArray:
    shrink = max(1, min(RING_REDUCTION, min(image.shape) // MIN_REDUCED_SIDE_PX))
    size = (image.shape[1] // shrink, image.shape[0] // shrink)
    return np.asarray(cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float64)


def _radial_gradients(log: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the rounded radius of every pixel, and the radial gradient per pixel."""
    height, width = log.shape
    offset = pixel_grid((width, height)) - (np.array([width, height]) - 1) / 2
    radius = np.linalg.norm(offset, axis=-1)
    down, across = np.gradient(log)
    psi = (offset[..., 0] * across + offset[..., 1] * down) / np.maximum(radius, 1e-9)
    return np.rint(radius).astype(np.int64), np.asarray(psi)


def _log_attenuation(ring: IntArray, psi: FloatArray, last: int, bending: float) -> FloatArray:
    """Return B in rings 0 to ``last``, 0 at the centre."""
    counts = np.bincount(ring, minlength=last + 1)
    if np.count_nonzero(counts) < last / 2:
        raise NotObservableError("too few well-exposed pixels at too many radii; the vignette cannot be estimated")
    step, second = np.diff(np.eye(last + 1), axis=0), np.diff(np.eye(last + 1), 2, axis=0)
    smooth = bending * second.T @ second + RING_RIDGE * np.eye(last + 1)
    weight = np.ones_like(psi)
    for _ in range(RING_ROUNDS):
        total, target = (
            np.bincount(ring, weights=part, minlength=last + 1)[1:] for part in (weight**2, weight**2 * psi)
        )
        log_v = np.linalg.solve(step.T @ (total[:, None] * step) + smooth, step.T @ target)
        residual = np.abs(psi - np.diff(log_v)[ring - 1]) + MIN_RING_RESIDUAL
        weight = np.exp(-residual) * (1 - np.exp(-RING_SPARSITY * residual ** (RING_SPARSITY - 1)))
    # Shading of the scene can dominate the vignette, but no lens gets brighter outwards.
    return np.append(0.0, np.cumsum(np.minimum(np.diff(log_v), 0)))


def _polynomial(size: ImageSize, log_v: FloatArray) -> PolynomialVignette:
    """Fit 1 + v₁R² + v₂R⁴ + v₃R⁶ to V at the radii :data:`FITTED_RADII`, weighted by the area of each ring."""
    v = np.exp(np.clip(log_v, np.log(MIN_RING_VIGNETTE), -np.log(MIN_RING_VIGNETTE)))
    powers, root = FITTED_RADII[:, None] ** np.array([2, 4, 6]), np.sqrt(FITTED_RADII)
    found = np.linalg.lstsq(root[:, None] * powers, root * (v - 1), rcond=None)[0]
    return PolynomialVignette(size, tuple(found.tolist()))
