"""Lin and Zhang, "Determining the radiometric response function from a single grayscale image", 2005.

An edge crosses pixels at all positions alike, so irradiances in its window spread evenly between those of its
regions: the histogram of g(Mₚ) is uniform. With Hₖ pixels in the k-th of b equal parts between g(M₁) and g(M₂),

    N(g; H) = 1/b Σₖ (|Hₖ| / |H| − 1/b)²,     g* = argmin  mean N − λ ln p(g)

The prior p is :mod:`~ospc.unknown_exposures.single_image.response_prior`. What the publication could not be checked
for: the weights that it gives to histograms. Counts jump when a pixel changes its part; here the parts are compared
through the cumulative distribution, N = mean (F(u) − u)², which does not jump and vanishes for the same histograms.
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.unknown_exposures.single_image.edge_patches import EdgePatches
from ospc.unknown_exposures.single_image.response_prior import response_prior

_PRIOR_WEIGHT = 0.001
"""λ: the weight of the prior."""

_MARGIN = 0.15
"""Part of the range between the regions, at either end, that is left out: there, pixels of the regions mix in."""

_FEWEST = 5
"""Pixels between these margins that a histogram needs."""

_LEAST_RANGE = 1e-6
"""Irradiance between two regions below which a curve counts as flat."""


def histogram_unevenness(patches: EdgePatches, curve: FloatArray) -> float:
    """Return how far irradiances at edges are from uniform, for g at equidistant grey levels.

    NotObservableError if hardly any pixel lies between its regions.
    """
    levels = np.arange(curve.size) * (255 / (curve.size - 1))
    grey, window = patches.edge[:, 0], patches.window
    low, high = np.minimum(patches.first, patches.second)[:, 0], np.maximum(patches.first, patches.second)[:, 0]
    low, high = low + _MARGIN * (high - low), high - _MARGIN * (high - low)
    inner = (grey > low[window]) & (grey < high[window])
    grey, window = grey[inner], window[inner]
    counts = np.bincount(window, minlength=len(low))
    if counts.max(initial=0) < _FEWEST:
        raise NotObservableError("too few pixels lie on edges to show how irradiances spread")
    order = np.lexsort((grey, window))
    grey, window = grey[order], window[order]
    place = np.arange(window.size) - (np.cumsum(counts) - counts)[window] + 0.5
    darkest, brightest, light = (np.interp(g, levels, curve) for g in (low[window], high[window], grey))
    share = (light - darkest) / np.maximum(brightest - darkest, _LEAST_RANGE)
    usable = (counts >= _FEWEST)[window]
    return float(np.mean((share - place / counts[window])[usable] ** 2))


def edge_histogram_response(patches: EdgePatches, prior_weight: float = _PRIOR_WEIGHT) -> Response:
    """Return the response for which irradiances at edges spread evenly; the first channel counts."""
    return response_prior().most_likely(
        lambda curve: histogram_unevenness(patches, curve), prior_weight, "edge-histograms"
    )
