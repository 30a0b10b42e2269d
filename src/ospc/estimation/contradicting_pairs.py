"""Detection of pairs of frames whose recorded exposures are wrong, from the residuals of a fit.

The points of a pair measure the ratio of its exposures to a fraction of a per cent. If a few exposures are wrong, or
a gain is switched, some pairs are brighter or darker than all others allow. Latent gains are no model of them: a
variance that is large enough for these pairs takes the weight from the others.
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, members_of
from ospc.estimation.fitted import Fitted
from ospc.numerics.robust import median, robust_scale
from ospc.settings.brightness import CONTRADICTING_PAIR_LOG, JUMP_SIGMAS, MIN_JUMP_SAMPLES
from ospc.settings.residuals import MAX_WRONG_PAIRS_SHARE


def rightly_exposed_points(fitted: Fitted) -> BoolArray:
    """Return which points are in pairs that do not contradict the exposure ratios of most others, shape (points,).

    Pairs of few points are not judged, and no pair is if so many deviate that they are no exceptions. Nor are points
    with more than two observations.
    """
    observations = fitted.observations
    right = np.ones(len(observations.starts), np.bool_)
    if not observations.in_pairs:
        return right
    usable = fitted.unclipped[0::2] & fitted.unclipped[1::2]
    log_radiance = fitted.fit.log_radiance(observations)
    change, number = log_radiance[1::2] - log_radiance[0::2], observations.group_number[0::2]
    pairs = [each[usable[each]] for each in members_of(number)]
    error = np.array([np.abs(median(change[each])) if len(each) >= MIN_JUMP_SAMPLES else np.nan for each in pairs])
    judged = error[np.isfinite(error)]
    wrong = error > max(CONTRADICTING_PAIR_LOG, JUMP_SIGMAS * robust_scale(judged))
    if np.count_nonzero(wrong) <= MAX_WRONG_PAIRS_SHARE * len(judged):
        right[wrong[number]] = False
    return right
