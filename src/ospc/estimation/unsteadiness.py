"""Whether the response is another from frame to frame: automatic contrast, gamma and picture modes."""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.estimation.fit import Fit
from ospc.estimation.robust import robust_scale
from ospc.observations import ExposedObservations
from ospc.photometry.effect_estimate import EffectEstimate
from ospc.settings.estimation import (
    DARKEST_GREY,
    UNSTEADY_FEWEST_PAIRS,
    UNSTEADY_FEWEST_POINTS,
    UNSTEADY_SIGMAS,
    UNSTEADY_SLOPE,
    UNSTEADY_SPREAD,
    WEIGHT_CUT_SIGMAS,
)

UNSTEADY = "unsteady response"
"""Name of the finding."""


def unsteady_response(fit: Fit, observations: ExposedObservations) -> tuple[EffectEstimate, ...]:
    """Return by how much the response differs between the frames of a pair; nothing if the pairs agree.

    With one response, the radiances that two frames show of the same points differ by chance alone. With another
    exponent in one frame their logarithms differ in proportion to ln M. The value is the standard deviation of that
    slope between pairs, without what the scatter inside them lets expect.

    Parameters
    ----------
    fit
        A fit.
    observations
        What it was made of.
    """
    first = observations.starts
    last = first + observations.counts - 1
    residual = fit.residuals(observations)
    change = residual[last] - residual[first]
    log_grey = np.log(np.maximum(observations.grey, DARKEST_GREY))
    level = (log_grey[first] + log_grey[last]) / 2
    group, known = observations.group[first], np.isfinite(change)
    found = [_slope(level, change, known & (group == number)) for number in np.unique(group[known])]
    slopes = [one for one in found if one is not None]
    if len(slopes) < UNSTEADY_FEWEST_PAIRS:
        return ()
    slope, sigma = np.array(slopes).T
    excess = np.sqrt(max(robust_scale(slope) ** 2 - float(np.median(sigma)) ** 2, 0.0))
    if robust_scale(slope / sigma) < UNSTEADY_SIGMAS or excess < UNSTEADY_SLOPE:
        return ()
    return (EffectEstimate(UNSTEADY, float(excess), float(excess / np.sqrt(2 * len(slope))), contradicts=True),)


def _slope(level: FloatArray, change: FloatArray, inside: BoolArray) -> tuple[float, float] | None:
    """Return the slope of the changes of one pair over ln M and its standard deviation; None if it has too few."""
    x, y = level[inside], change[inside] - np.median(change[inside])
    usual = np.abs(y) <= WEIGHT_CUT_SIGMAS * robust_scale(y)
    x, y = x[usual] - x[usual].mean(), y[usual] - y[usual].mean()
    spread = float(x @ x)
    if len(x) < UNSTEADY_FEWEST_POINTS or spread < UNSTEADY_SPREAD**2 * len(x):
        return None
    slope = float(x @ y) / spread
    left = y - slope * x
    variance = float(left @ left) / (len(x) - 2) / spread
    return (slope, np.sqrt(variance)) if variance > 0 else None
