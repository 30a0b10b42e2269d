"""Smoothing over the same part of the scene in two views, despite their different scale and shape."""

from __future__ import annotations

import numpy as np

from ospc.arrays import Float32Array, FloatArray
from ospc.settings.sampling import MAX_STRETCH, NODES_PER_SIDE, PIXEL_VARIANCE

_TAPS = np.arange(NODES_PER_SIDE) - NODES_PER_SIDE // 2
"""Offsets of the nodes along one axis, shape (5,)."""

NODES = np.stack(np.meshgrid(_TAPS, _TAPS), axis=-1).reshape(-1, 2)
"""Offsets (x, y) of the nodes from the sampled point, in reduced pixels, shape (25, 2)."""

_EVEN = np.equal.outer(np.abs(_TAPS), np.arange(NODES_PER_SIDE // 2 + 1)).astype(np.float64)
"""Which of the taps have the same distance, and thus the same weight, shape (5, 3)."""
_SLOPE, _CURVATURE = np.array([0, -0.5, 0, 0.5, 0]), np.array([-2, 1, 0])
"""Weights of the taps that give the first derivative, and of the distances that give the second."""

_SUMS = np.concatenate([np.kron(_EVEN, _EVEN), np.kron(_SLOPE, _SLOPE)[:, None]], axis=1)
"""Contribution of each node to the sums of :func:`node_sums`, shape (25, 10)."""

CENTRE = 0
"""Index of the sum that is the value at the sampled point itself."""


def node_sums(values: FloatArray | Float32Array) -> FloatArray:
    """Return the sums of the values at the :data:`NODES` that are weighted alike, shape (n, 25) -> (n, 10).

    The last one is the derivative along x and y.
    """
    return np.asarray(values @ _SUMS)


def further_smoothing(
    jacobian: FloatArray, smoothing_px: float, interpolation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the additional smoothing of each of two views, as covariances, shape (n, 2, 2) each.

    Along each axis, the view with the larger scale is smoothed correspondingly more. ``jacobian`` is that of the
    mapping from the first to the second view, and ``interpolation`` is the :func:`interpolation_smoothing` in the
    second, shape (n, 2, 2) each.
    """
    axes1, stretch, axes0 = np.linalg.svd(jacobian)
    stretch = np.clip(stretch, 1 / MAX_STRETCH, MAX_STRETCH)
    variance = smoothing_px**2 + PIXEL_VARIANCE
    further0, further1 = (variance * np.maximum(by**2 - 1, 0)[:, None] for by in (1 / stretch, stretch))
    along0 = np.swapaxes(axes0, 1, 2)
    back = along0 / stretch[:, None] @ np.swapaxes(axes1, 1, 2)
    # Interpolation cannot be undone without more noise, but the same can be done to the first view.
    as_interpolated = back @ interpolation @ np.swapaxes(back, 1, 2)
    return along0 * further0 @ axes0 + as_interpolated, axes1 * further1 @ np.swapaxes(axes1, 1, 2)


def node_weights(covariance: FloatArray) -> FloatArray:
    """Return the weights of the :func:`node_sums` that apply the additional smoothing, shape (n, 10).

    The covariances have shape (n, 2, 2). Smoothing along x and y is that of :func:`_taps`; a correlation of x and y
    adds its Taylor series.
    """
    along_x, along_y = (_taps(covariance[:, axis, axis]) for axis in (0, 1))
    correlation = covariance[:, :1, 1]
    of_correlation = correlation[:, :, None] ** 2 / 2 * np.outer(_CURVATURE, _CURVATURE)
    even = along_y[:, :, None] * along_x[:, None, :] + of_correlation
    return np.concatenate([even.reshape(len(even), len(_CURVATURE) ** 2), correlation], axis=1)


def _taps(variance: FloatArray) -> FloatArray:
    """Return the weights at each distance with the variance and fourth moment of a Gaussian, (n,) -> (n, 3)."""
    # From 4/3 on, the nearer two of the neighbours would get negative weights. There they get none, as in the
    # Gauss-Hermite rule that both agree on at 4/3, and only the variance is right.
    farther = np.where(variance < 4 / 3, (3 * variance - 1) * variance / 24, variance / 8)
    nearer = variance / 2 - 4 * farther
    return np.stack([1 - 2 * (nearer + farther), nearer, farther], axis=1)


def interpolation_smoothing(places: FloatArray) -> FloatArray:
    """Return the smoothing due to linear interpolation at points, (n, 2), as covariances, shape (n, 2, 2)."""
    share = places % 1
    return np.eye(2) * (share * (1 - share))[:, None]
