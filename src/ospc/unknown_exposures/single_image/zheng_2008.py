"""Vignettes from single images, by Zheng, Lin et al.: radial gradients (2008), and segments (2006, 2009).

**Radial gradients** ("Single-image vignetting correction using radial gradient symmetry", 2008). In natural images,
the distribution of the radial gradients ψ of ln I is symmetric about zero; a vignette shifts all gradients at one
radius by the same amount. With B = ln V in rings of one pixel,

    argmin Σ w² |ψ − (B_r − B_{r−1})|² + (2λ N/R)² Σ (B_{r+1} − 2 B_r + B_{r−1})²,    N pixels, R rings

is solved by iteratively reweighted least squares, w = exp(−s₁)(1 − exp(−s₂)), s₁ = |ψ − (B_r − B_{r−1})|,
s₂ = α s₁^(α−1). All numbers are those of the program published by the first author (vignCorrection_nonPara, 2010):
λ 0.3, α 0.6, four iterations, images reduced to a quarter of their size, ln(M + 1) for grey levels up to 255. One
deviation: V never increases outwards.

**Segments** ("Single-image vignetting correction", 2006 and 2009). Within a segment of constant radiance, ln I
follows ln V. Segmentation and V are refined alternately, with the model of Kang and Weiss without tilt, V = (1 − a r)
/ (1 + (r/f)²)². The published weights of segments could not be verified. Here segments are connected pixels with
small gradients, weighted by their number of pixels; the publication uses mean shift, and also classifies segments by
their texture.

Images are irradiances, g(M); clipped pixels are excluded.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.optimize import least_squares

from ospc.arrays import BoolArray, FloatArray, ImageSize, IntArray
from ospc.errors import NotObservableError
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.vignette import PolynomialVignette
from ospc.settings.single_image import (
    DARKEST_SEGMENT_IRRADIANCE,
    FITTED_RADII,
    MAX_SEGMENT_GRADIENT,
    MIN_REDUCED_SIDE_PX,
    MIN_RING_RESIDUAL,
    MIN_SEGMENT_PIXELS,
    MIN_SEGMENT_VIGNETTE,
    RING_OFFSET,
    RING_REDUCTION,
    RING_RIDGE,
    RING_ROUNDS,
    RING_SMOOTHNESS,
    RING_SPARSITY,
    SEGMENT_HUBER,
    SEGMENT_SMOOTHING_PX,
    SEGMENT_START,
    SEGMENTATIONS,
)


def radial_gradient_vignette(
    images: Sequence[FloatArray], masks: Sequence[BoolArray] | None = None, smoothness: float = RING_SMOOTHNESS
) -> PolynomialVignette:
    """Estimate the vignette of images of equal size from the symmetry of their radial gradients.

    The images are irradiances, shape (height, width) each. Masks are true for well-exposed pixels, and default to all
    pixels. ``smoothness`` is λ. NotObservableError if too few pixels are well exposed.
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
    bending = (2 * smoothness * ring.size / (last + 1)) ** 2 * len(images)
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
    v = np.exp(np.clip(log_v, np.log(MIN_SEGMENT_VIGNETTE), -np.log(MIN_SEGMENT_VIGNETTE)))
    powers, root = FITTED_RADII[:, None] ** np.array([2, 4, 6]), np.sqrt(FITTED_RADII)
    found = np.linalg.lstsq(root[:, None] * powers, root * (v - 1), rcond=None)[0]
    return PolynomialVignette(size, tuple(found.tolist()))


def segment_vignette(image: FloatArray) -> PolynomialVignette:
    """Estimate the vignette of an image of irradiances in [0, 1], shape (height, width), from its segments.

    NotObservableError if there is no segment of even radiance.
    """
    size = (image.shape[1], image.shape[0])
    small = _reduced(image)
    radius = np.linalg.norm(normalised(pixel_grid(small.shape[::-1]), small.shape[::-1]), axis=-1)
    log = np.log(np.maximum(small, DARKEST_SEGMENT_IRRADIANCE))
    found = np.array(SEGMENT_START)
    for _ in range(SEGMENTATIONS):
        segment = _segments(small / np.exp(_log_kang_weiss(found, radius)))
        kept = (segment >= 0) & (small > DARKEST_SEGMENT_IRRADIANCE)
        if not kept.any():
            raise NotObservableError("the image has no segments of even radiance; its vignette cannot be estimated")
        found = _fitted(segment[kept], radius[kept], log[kept], found)
    return _polynomial(size, _log_kang_weiss(found, FITTED_RADII))


def _log_kang_weiss(parameters: FloatArray, radius: FloatArray) -> FloatArray:
    """Return ln V for the parameters a and 1/f²."""
    return np.asarray(
        np.log(np.maximum(1 - parameters[0] * radius, MIN_SEGMENT_VIGNETTE)) - 2 * np.log1p(parameters[1] * radius**2)
    )


def _segments(light: FloatArray) -> IntArray:
    """Return the segment number of each pixel, -1 in segments that are too small."""
    smooth = cv2.GaussianBlur(np.log(np.maximum(light, DARKEST_SEGMENT_IRRADIANCE)), (0, 0), SEGMENT_SMOOTHING_PX)
    down, across = np.gradient(smooth)
    _, labels = cv2.connectedComponents(
        (np.hypot(down, across) < MAX_SEGMENT_GRADIENT).astype(np.uint8), connectivity=4
    )
    large = np.bincount(labels.ravel()) >= MIN_SEGMENT_PIXELS
    large[0] = False
    return np.where(large[labels], labels, -1).astype(np.int64)


def _fitted(segment: IntArray, radius: FloatArray, log: FloatArray, start: FloatArray) -> FloatArray:
    """Return the a and 1/f² that minimise the variation of ln I − ln V within segments."""
    _, member = np.unique(segment, return_inverse=True)
    counts = np.bincount(member)

    def residuals(parameters: FloatArray) -> FloatArray:
        flat = log - _log_kang_weiss(parameters, radius)
        return np.asarray(flat - (np.bincount(member, weights=flat) / counts)[member])

    bounds = ([0.0, 0.0], [1 - MIN_SEGMENT_VIGNETTE, np.inf])
    return np.asarray(least_squares(residuals, start, bounds=bounds, loss="huber", f_scale=SEGMENT_HUBER).x)
