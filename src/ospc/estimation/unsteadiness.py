"""Whether response and vignette differ from frame to frame: automatic contrast, electronic stabilisation."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, IntArray, members_of
from ospc.observations import ExposedObservations
from ospc.photometry.effect_estimate import EffectEstimate
from ospc.robust import robust_scale
from ospc.settings.estimation import (
    DARKEST_GREY,
    UNSTEADY_FEWEST_PAIRS,
    UNSTEADY_FEWEST_POINTS,
    UNSTEADY_SIGMAS,
    UNSTEADY_SLOPE,
    UNSTEADY_SPREAD,
    WEIGHT_CUT_SIGMAS,
)

UNSTEADY_RESPONSE, UNSTEADY_VIGNETTE = "unsteady response", "unsteady vignette"
"""Names of the findings."""


def unsteadiness(residual: FloatArray, observations: ExposedObservations) -> tuple[EffectEstimate, ...]:
    """Return what differs between the frames of a pair; nothing if the pairs agree.

    With one response and one vignette, the radiances that two frames show of the same points differ by chance alone.
    With another exponent in one frame, their logarithms differ in proportion to ln M; with a vignette that was moved,
    in proportion to x and y. The value is the standard deviation of that slope between pairs, without what the
    scatter inside them lets expect. The parameters are those of
    :func:`~ospc.estimation.unevenness.uneven_vignette`.
    """
    first = observations.starts
    last = first + observations.counts - 1
    change = residual[last] - residual[first]
    known = np.flatnonzero(np.isfinite(change))
    pairs = [known[members] for members in members_of(observations.group[first][known])]
    log_grey = np.log(np.maximum(observations.grey, DARKEST_GREY))
    x, y = ((observations.position[first] + observations.position[last]) / 2).T
    found = []
    for name, covariates in (
        (UNSTEADY_RESPONSE, [(log_grey[first] + log_grey[last]) / 2]),
        (UNSTEADY_VIGNETTE, [x, y]),
    ):
        excess, slopes = max(_excess(covariate, change, pairs) for covariate in covariates)
        if excess > UNSTEADY_SLOPE:
            found.append(EffectEstimate(name, excess, excess / np.sqrt(2 * slopes), contradicts=True))
    return tuple(found)


def _excess(covariate: FloatArray, change: FloatArray, pairs: list[IntArray]) -> tuple[float, int]:
    """Return the standard deviation of the slope between pairs, 0 if chance explains it, and the number of slopes."""
    slopes = [one for one in (_slope(covariate[pair], change[pair]) for pair in pairs) if one is not None]
    if len(slopes) < UNSTEADY_FEWEST_PAIRS:
        return 0.0, len(slopes)
    slope, sigma = np.array(slopes).T
    if robust_scale(slope / sigma) < UNSTEADY_SIGMAS:
        return 0.0, len(slopes)
    return float(np.sqrt(max(robust_scale(slope) ** 2 - float(np.median(sigma)) ** 2, 0.0))), len(slopes)


def _slope(x: FloatArray, change: FloatArray) -> tuple[float, float] | None:
    """Return the slope of the changes of one pair and its standard deviation; None if it has too few points."""
    # Late in a long run most pairs have a point or two left: medians of all these take long.
    if len(x) < UNSTEADY_FEWEST_POINTS:
        return None
    deviation = change - np.median(change)
    usual = np.abs(deviation) <= WEIGHT_CUT_SIGMAS * robust_scale(deviation)
    x, y = x[usual] - x[usual].mean(), change[usual] - change[usual].mean()
    spread = float(x @ x)
    if len(x) < UNSTEADY_FEWEST_POINTS or spread < UNSTEADY_SPREAD**2 * len(x):
        return None
    slope = float(x @ y) / spread
    left = y - slope * x
    variance = float(left @ left) / (len(x) - 2) / spread
    return (slope, np.sqrt(variance)) if variance > 0 else None
