"""Zheng, Lin and others on the vignette of a single image: radial gradients (2008), and segments (2006, 2009).

**Radial gradients** ("Single-image vignetting correction using radial gradient symmetry", 2008). In natural images,
the gradients ψ of ln I along the radius are symmetric about zero; a vignette adds the same to all at one radius. With
B = ln V in rings of one pixel,

    argmin Σ w² |ψ − (B_r − B_{r−1})|² + (2λ N/R)² Σ (B_{r+1} − 2 B_r + B_{r−1})²,    N pixels, R rings

by iteratively reweighted least squares, w = exp(−s₁)(1 − exp(−s₂)), s₁ = |ψ − (B_r − B_{r−1})|, s₂ = α s₁^(α−1). All
numbers are those of the program that its first author has published (vignCorrection_nonPara, 2010): λ 0.3, α 0.6,
four turns, images of a quarter of their size, ln(M + 1) for grey levels up to 255. One departure: V never grows
outwards.

**Segments** ("Single-image vignetting correction", 2006 and 2009). Within a segment of one radiance, ln I falls as
ln V does. Segmentation and V are improved in turn, V by the model of Kang and Weiss without tilt,
V = (1 − a r) / (1 + (r/f)²)². Not verified: the weights of segments. Segments are connected pixels of small gradients
here, and count by their pixels; the publication uses mean shift, and sorts segments by their texture, too.

Images are irradiances, g(M); clipped pixels are left out.
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

_SPARSITY, _SMOOTHNESS, _TURNS = 0.6, 0.3, 4
"""α, λ, and turns of reweighting."""

_SHRINK, _SHIFT = 4, 1 / 255
"""Images are used at a quarter of their size; added to irradiances, so that their logarithms stay finite."""

_SMALLEST_SIDE = 60
"""Pixels of the shorter side below which an image is not made smaller: rings need pixels."""

_RIDGE = 1e-9
"""Pull of B to zero, which makes it unique."""

_LEAST_RESIDUAL = 1e-9
"""Added to s₁, whose power is negative."""

_PLACES = np.linspace(0, 1, 61)
"""Radii at which V is fitted by a polynomial."""

_DARKEST = 1e-3
"""Irradiance below which its logarithm is noise, for segments."""

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
    images: Sequence[FloatArray], masks: Sequence[BoolArray] | None = None, smoothness: float = _SMOOTHNESS
) -> PolynomialVignette:
    """Return the vignette of images of one size by the symmetry of their radial gradients.

    The images are irradiances, shape (height, width) each, with masks that are true where pixels are exposed, all by
    default; ``smoothness`` is λ. NotObservableError if too few pixels are exposed.
    """
    size = (images[0].shape[1], images[0].shape[0])
    rings, gradients = [], []
    for number, image in enumerate(images):
        small, exposed = _small(image, None if masks is None else masks[number])
        ring, psi = _radial_gradients(np.log(small + _SHIFT))
        kept = exposed & (ring > 0)
        rings.append(ring[kept])
        gradients.append(psi[kept])
    last = int(ring.max())
    # As for one image, however many there are.
    bending = (2 * smoothness * ring.size / (last + 1)) ** 2 * len(images)
    log_v = _log_attenuation(np.concatenate(rings), np.concatenate(gradients), last, bending)
    return _polynomial(size, np.interp(_PLACES, np.arange(last + 1) / last, log_v))


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


def _radial_gradients(log: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the radius of every pixel in whole pixels, and the gradient along it, per pixel."""
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
        raise NotObservableError("too few exposed pixels at too many radii; the vignette cannot be estimated")
    step, second = np.diff(np.eye(last + 1), axis=0), np.diff(np.eye(last + 1), 2, axis=0)
    smooth = bending * second.T @ second + _RIDGE * np.eye(last + 1)
    weight = np.ones_like(psi)
    for _ in range(_TURNS):
        total, target = (
            np.bincount(ring, weights=part, minlength=last + 1)[1:] for part in (weight**2, weight**2 * psi)
        )
        log_v = np.linalg.solve(step.T @ (total[:, None] * step) + smooth, step.T @ target)
        residual = np.abs(psi - np.diff(log_v)[ring - 1]) + _LEAST_RESIDUAL
        weight = np.exp(-residual) * (1 - np.exp(-_SPARSITY * residual ** (_SPARSITY - 1)))
    # Shading can outweigh a vignette; but no lens gets brighter outwards.
    return np.append(0.0, np.cumsum(np.minimum(np.diff(log_v), 0)))


def _polynomial(size: ImageSize, log_v: FloatArray) -> PolynomialVignette:
    """Return the 1 + v₁R² + v₂R⁴ + v₃R⁶ nearest to V at :data:`_PLACES`; each counts by the area of its ring."""
    v = np.exp(np.clip(log_v, np.log(_LEAST_V), -np.log(_LEAST_V)))
    powers, root = _PLACES[:, None] ** np.array([2, 4, 6]), np.sqrt(_PLACES)
    found = np.linalg.lstsq(root[:, None] * powers, root * (v - 1), rcond=None)[0]
    return PolynomialVignette(size, tuple(found.tolist()))


def segment_vignette(image: FloatArray) -> PolynomialVignette:
    """Return the vignette of an image of irradiances in [0, 1], shape (height, width), by its segments.

    NotObservableError if there is no segment of even radiance.
    """
    size = (image.shape[1], image.shape[0])
    small, _ = _small(image, None)
    radius = np.linalg.norm(normalised(pixel_grid(small.shape[::-1]), small.shape[::-1]), axis=-1)
    log = np.log(np.maximum(small, _DARKEST))
    found = np.array(_START)
    for _ in range(_SEGMENTATIONS):
        segment = _segments(small / np.exp(_log_kang_weiss(found, radius)))
        kept = (segment >= 0) & (small > _DARKEST)
        if not kept.any():
            raise NotObservableError("the image has no segments of even radiance; its vignette cannot be estimated")
        found = _fitted(segment[kept], radius[kept], log[kept], found)
    return _polynomial(size, _log_kang_weiss(found, _PLACES))


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
