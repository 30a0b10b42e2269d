"""Zheng, Lin and others on the vignette of a single image: radial gradients (2008), and segments (2006, 2009).

**Radial gradients** ("Single-image vignetting correction using radial gradient symmetry", 2008). In natural images,
the gradients of ln I along the radius are symmetric about zero; a vignette adds the same ψᵥ(r) to all at one radius:

    ψ(r, θ) = ψᵢ(r, θ) + ψᵥ(r),    ψᵥ = argmin Σ |ψ(r, θ) − ψᵥ(r)|^α + λ Σ ψᵥ''(r)²,    ln V(r) = ∫ ψᵥ dr

with α 0.6 and λ 0.3, by iteratively reweighted least squares: w = exp(−s₁)(1 − exp(−s₂)), s₁ = |ψ − ψᵥ|,
s₂ = α s₁^(α−1), on images of a quarter of their size. Here ψ is per half diagonal, and ψᵥ at most 0.

**Segments** ("Single-image vignetting correction", 2006 and 2009). Within a segment of one radiance, ln I falls as
ln V does. Segmentation and V are improved in turn, V by the model of Kang and Weiss without tilt,
V = (1 − a r) / (1 + (r/f)²)².

Images are irradiances, g(M). Not verified: how the publications bin radii, and the weights of segments. Segments
are connected pixels of small gradients here, and count by their pixels; the publication uses mean shift, and sorts
segments by their texture, too.
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

_SPARSITY, _SMOOTHNESS, _ROUNDS = 0.6, 0.3, 20
"""α, λ, and turns of reweighting."""

_SHRINK = 4
"""Images are used at a quarter of their size, which averages fine texture and noise."""

_SMALLEST_SIDE = 60
"""Pixels of the shorter side below which an image is not made smaller: rings need pixels."""

_RINGS, _FEWEST_IN_RING = 60, 8
"""Rings of equal width from the centre to the corners, and pixels that one needs."""

_DARKEST = 1e-3
"""Irradiance below which its logarithm is noise."""

_RIDGE = 1e-9
"""Pull of ψᵥ to zero, which makes it unique where no ring has pixels."""

_LEAST_RESIDUAL = 1e-4
"""|ψ − ψᵥ| below which weights do not grow any further."""

_SMOOTHING_PX, _EVEN = 0.7, 0.03
"""Smoothing before segmentation, and gradient of ln I per pixel up to which neighbours are one surface."""

_START = (0.1, 0.1)
"""a and 1/f² that the fit starts from: within their bounds, where it can move."""

_SEGMENTATIONS, _FEWEST_IN_SEGMENT = 4, 60
"""Turns of segmentation and V, and pixels that a segment needs."""

_HUBER = 0.05
"""Residual of ln I beyond which it counts less: a texture, or a segment of two radiances."""

_LEAST_V = 0.05
"""Attenuation below which a fit is not followed: no lens loses more that still shows an image."""


def radial_gradient_vignette(
    images: Sequence[FloatArray], masks: Sequence[BoolArray] | None = None
) -> PolynomialVignette:
    """Return the vignette of images of one size by the symmetry of their radial gradients.

    Parameters
    ----------
    images
        Irradiances, shape (height, width) each.
    masks
        True where pixels are exposed; all by default.

    Raises
    ------
    NotObservableError
        If too few pixels are exposed.
    """
    size = (images[0].shape[1], images[0].shape[0])
    rings, gradients = [], []
    for number, image in enumerate(images):
        small, exposed = _small(image, None if masks is None else masks[number])
        radius, ring, psi = _radial_gradients(np.log(np.maximum(small, _DARKEST)))
        kept = exposed & (small > _DARKEST) & (radius > 1 / _RINGS)
        rings.append(ring[kept])
        gradients.append(psi[kept])
    # Shading can outweigh a vignette; but no lens gets brighter outwards.
    slope = np.minimum(_symmetric_part(np.concatenate(rings), np.concatenate(gradients)), 0)
    edges = np.arange(_RINGS + 1) / _RINGS
    log_v = np.append(0.0, np.cumsum(slope) / _RINGS)
    return _polynomial(size, edges, log_v)


def _small(image: FloatArray, mask: BoolArray | None) -> tuple[FloatArray, BoolArray]:
    """Return the image at a quarter of its size, and which pixels are exposed there."""
    shrink = max(1, min(_SHRINK, min(image.shape) // _SMALLEST_SIDE))
    size = (image.shape[1] // shrink, image.shape[0] // shrink)
    small = cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    if mask is None:
        return np.asarray(small, dtype=np.float64), np.ones(small.shape, dtype=bool)
    whole = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    # Gradients reach into the neighbours.
    return np.asarray(small, dtype=np.float64), cv2.erode(whole, np.ones((3, 3), np.uint8)) > 1 - 1e-6


def _radial_gradients(log: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return radius, ring and radial gradient of every pixel, per half diagonal."""
    offset = normalised(pixel_grid((log.shape[1], log.shape[0])), (log.shape[1], log.shape[0]))
    radius = np.linalg.norm(offset, axis=-1)
    step = float(offset[0, 1, 0] - offset[0, 0, 0])
    down, across = np.gradient(log, step)
    psi = (offset[..., 0] * across + offset[..., 1] * down) / np.maximum(radius, 1e-9)
    ring = np.minimum((radius * _RINGS).astype(np.int64), _RINGS - 1)
    return radius, ring, np.asarray(psi)


def _symmetric_part(ring: IntArray, psi: FloatArray) -> FloatArray:
    """Return ψᵥ in every ring by iteratively reweighted least squares."""
    counts = np.bincount(ring, minlength=_RINGS)
    if np.count_nonzero(counts >= _FEWEST_IN_RING) < _RINGS // 2:
        raise NotObservableError("too few exposed pixels at too many radii; the vignette cannot be estimated")
    second = np.diff(np.eye(_RINGS), 2, axis=0)
    # Weights are means within a ring, so that λ does not depend on the size of the image.
    share = np.minimum(1.0, counts / _FEWEST_IN_RING) / np.maximum(counts, 1)
    slope: FloatArray = np.zeros(_RINGS)
    for turn in range(_ROUNDS):
        residual = np.maximum(np.abs(psi - slope[ring]), _LEAST_RESIDUAL)
        weight = np.exp(-residual) * (1 - np.exp(-_SPARSITY * residual ** (_SPARSITY - 1)))
        weight = np.ones_like(psi) if turn == 0 else weight
        total = np.bincount(ring, weights=weight, minlength=_RINGS) * share
        target = np.bincount(ring, weights=weight * psi, minlength=_RINGS) * share
        matrix = np.diag(total) + _SMOOTHNESS * second.T @ second + _RIDGE * np.eye(_RINGS)
        slope = np.asarray(np.linalg.solve(matrix, target), dtype=np.float64)
    return slope


def _polynomial(size: ImageSize, radius: FloatArray, log_v: FloatArray) -> PolynomialVignette:
    """Return the 1 + v₁R² + v₂R⁴ + v₃R⁶ nearest to V at these radii; each counts by the area of its ring."""
    v = np.exp(np.clip(log_v, np.log(_LEAST_V), -np.log(_LEAST_V)))
    powers = radius[:, None] ** np.array([2, 4, 6])
    root = np.sqrt(radius)[:, None]
    found = np.linalg.lstsq(root * powers, root[:, 0] * (v - 1), rcond=None)[0]
    return PolynomialVignette(size, tuple(found.tolist()))


def segment_vignette(image: FloatArray) -> PolynomialVignette:
    """Return the vignette of an image of irradiances in [0, 1], shape (height, width), by its segments.

    Raises
    ------
    NotObservableError
        If there is no segment of even radiance.
    """
    size = (image.shape[1], image.shape[0])
    small, _ = _small(image, None)
    radius, *_ = _radial_gradients(small)
    log = np.log(np.maximum(small, _DARKEST))
    found = np.array(_START)
    for _ in range(_SEGMENTATIONS):
        segment = _segments(small / np.exp(_log_kang_weiss(found, radius)))
        kept = (segment >= 0) & (small > _DARKEST)
        if not kept.any():
            raise NotObservableError("the image has no segments of even radiance; its vignette cannot be estimated")
        found = _fitted(segment[kept], radius[kept], log[kept], found)
    places = np.linspace(0, 1, _RINGS + 1)
    return _polynomial(size, places, _log_kang_weiss(found, places))


def _log_kang_weiss(parameters: FloatArray, radius: FloatArray) -> FloatArray:
    """Return ln V for the parameters a and 1/f²."""
    return np.asarray(
        np.log(np.maximum(1 - parameters[0] * radius, _LEAST_V)) - 2 * np.log1p(parameters[1] * radius**2)
    )


def _segments(light: FloatArray) -> IntArray:
    """Return the number of each pixel's segment, -1 in those that are too small."""
    smooth = cv2.GaussianBlur(np.log(np.maximum(light, _DARKEST)), (0, 0), _SMOOTHING_PX)
    down, across = np.gradient(smooth)
    _, labels = cv2.connectedComponents((np.hypot(down, across) < _EVEN).astype(np.uint8), connectivity=4)
    large = np.bincount(labels.ravel()) >= _FEWEST_IN_SEGMENT
    large[0] = False
    return np.where(large[labels], labels, -1).astype(np.int64)


def _fitted(segment: IntArray, radius: FloatArray, log: FloatArray, start: FloatArray) -> FloatArray:
    """Return a and 1/f² for which ln I − ln V varies least within segments."""
    _, member = np.unique(segment, return_inverse=True)
    counts = np.bincount(member)

    def residuals(parameters: FloatArray) -> FloatArray:
        flat = log - _log_kang_weiss(parameters, radius)
        return np.asarray(flat - (np.bincount(member, weights=flat) / counts)[member])

    bounds = ([0.0, 0.0], [1 - _LEAST_V, np.inf])
    return np.asarray(least_squares(residuals, start, bounds=bounds, loss="huber", f_scale=_HUBER).x)
