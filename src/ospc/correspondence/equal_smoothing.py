"""Smoothing over the same part of the scene in two views, despite their different scale and shape."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray
from ospc.settings.sampling import (
    MAX_STRETCH,
    NODE_STEP_PX,
    PIXEL_VARIANCE,
)

NODES = np.stack(np.meshgrid(*2 * [NODE_STEP_PX * np.arange(-1.0, 2.0)]), axis=-1).reshape(9, 2)
"""Offsets (x, y) of the nodes from the sampled point, in reduced pixels, shape (9, 2)."""

CENTRE = 4
"""Index of the node at the sampled point itself."""

_VALUE, _SLOPE, _CURVATURE = (np.array(stencil) for stencil in ([0, 1, 0], [-0.5, 0, 0.5], [1, -2, 1]))
_STENCILS = np.stack(
    [
        np.outer(_VALUE, _VALUE),
        np.outer(_VALUE, _CURVATURE) / NODE_STEP_PX**2,
        np.outer(_CURVATURE, _VALUE) / NODE_STEP_PX**2,
        np.outer(_SLOPE, _SLOPE) / NODE_STEP_PX**2,
        np.outer(_CURVATURE, _CURVATURE) / NODE_STEP_PX**4,
    ]
).reshape(5, 9)
"""Weights of the nodes that give the value and its derivatives xx, yy, xy and xxyy, shape (5, 9)."""


def further_smoothing(jacobian: FloatArray, smoothing_px: float) -> tuple[FloatArray, FloatArray]:
    """Return the additional smoothing of each of two views, as covariances, shape (n, 2, 2) each.

    Along each axis, the view with the larger scale is smoothed correspondingly more. ``jacobian`` is that of the
    mapping from the first to the second view, shape (n, 2, 2).
    """
    axes1, stretch, axes0 = np.linalg.svd(jacobian)
    stretch = np.clip(stretch, 1 / MAX_STRETCH, MAX_STRETCH)
    variance = smoothing_px**2 + PIXEL_VARIANCE
    further0, further1 = (variance * np.maximum(by**2 - 1, 0)[:, None] for by in (1 / stretch, stretch))
    return np.swapaxes(axes0, 1, 2) * further0 @ axes0, axes1 * further1 @ np.swapaxes(axes1, 1, 2)


def node_weights(covariance: FloatArray) -> FloatArray:
    """Return the weights of the values at the :data:`NODES` that apply the additional smoothing, shape (n, 9).

    The covariances have shape (n, 2, 2). The weighted sum is the mean of the Taylor series about the point over a
    Gaussian, up to its term in x²y².
    """
    xx, yy, xy = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    expected = np.stack([np.ones_like(xx), xx / 2, yy / 2, xy, xx * yy / 4 + xy**2 / 2], axis=1)
    return np.asarray(expected @ _STENCILS)


def interpolation_smoothing(places: FloatArray) -> FloatArray:
    """Return the smoothing due to linear interpolation at points, (n, 2), as covariances, shape (n, 2, 2)."""
    share = places % 1
    return np.eye(2) * (share * (1 - share))[:, None]
