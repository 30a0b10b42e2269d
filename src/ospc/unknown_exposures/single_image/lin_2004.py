"""Lin, Gu, Yamazaki and Shum, "Radiometric calibration from a single image", 2004: one colour image.

A pixel on the edge between two regions has the irradiance α I₁ + (1 − α) I₂ in every channel, with the same α. So its
colour lies on the line between the region colours in irradiances, and g has to bring it there:

    d = |(g(M₁) − g(M₂)) × (g(Mₚ) − g(M₂))| / |g(M₁) − g(M₂)|²,     g* = argmin  mean d − λ ln p(g)

All channels share one response. The prior p is :mod:`~ospc.unknown_exposures.single_image.response_prior`.

Departures: the publication does not divide by the length of the line a second time. Its distances become small for
every g that is nearly zero up to the brightest greys, and only a prior learned from real cameras keeps it from there;
relative to the line, d has no such escape. Its thresholds for windows could not be verified. That d is the mean over
all edge pixels, and that the prior counts once for each channel, is as in an independent implementation (Lalonde).
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.unknown_exposures.single_image.edge_patches import EdgePatches
from ospc.unknown_exposures.single_image.response_prior import response_prior

_PRIOR_WEIGHT = 3 * 0.001
"""λ for each of three channels."""

_LEAST_SQUARE = 1e-12
"""Square of a line's length below which it counts as a point: a guard against division by zero."""


def edge_colour_distance(patches: EdgePatches, curve: FloatArray) -> float:
    """Return the mean distance d of edge colours from the lines between their regions, g at equidistant greys."""
    first, second, edge = patches.linearised(curve)
    line, offset = first - second, edge - second
    area = np.linalg.norm(np.cross(line, offset), axis=1)
    return float(np.mean(area / np.maximum(np.sum(line**2, axis=1), _LEAST_SQUARE)))


def edge_colour_response(patches: EdgePatches, prior_weight: float = _PRIOR_WEIGHT) -> Response:
    """Return the response for which edge colours are on the lines between the colours of their regions.

    NotObservableError if the patches have no colours.
    """
    if patches.first.shape[1] != 3:
        raise NotObservableError("the colours of edges are needed, and the image is grey")
    return response_prior().most_likely(
        lambda curve: edge_colour_distance(patches, curve), prior_weight, "edge-colours"
    )
