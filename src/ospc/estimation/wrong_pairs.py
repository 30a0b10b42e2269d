"""Detection of pairs of frames that were registered or exposed wrongly, from the residuals of a fit.

On a regular facade or a tiled floor, registration may be off by a whole window or tile, forward and back alike. The
two grey levels of a point are then those of different places, and their residuals scatter within the pair far more
than in others.

The points of a pair measure the ratio of its exposures to a fraction of a per cent. If a few exposures are wrong, or
a gain is switched, some pairs are brighter or darker than all others allow. Latent gains are no model of them: a
variance that is large enough for these pairs takes the weight from the others.
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray, members_of
from ospc.estimation.fitted import Fitted
from ospc.estimation.robust_weights import redescending_weights
from ospc.numerics.robust import median, robust_scale
from ospc.observations import ExposedObservations
from ospc.settings.brightness import CONTRADICTING_PAIR_LOG, JUMP_SIGMAS, MIN_JUMP_SAMPLES
from ospc.settings.error_model import DARKEST_GREY
from ospc.settings.residuals import (
    AGREEING_SHARE,
    MAX_WRONG_PAIRS_SHARE,
    MISREGISTERED_FEWEST_POINTS,
    MISREGISTERED_ITERATIONS,
    MISREGISTERED_SPREAD,
    USUAL_PAIRS,
)


def registered_points(fitted: Fitted) -> BoolArray:
    """Return which points are in pairs that scatter like the others, shape (points,).

    If response, vignette or effects are wrong, residuals vary smoothly with grey level, position and surroundings.
    Only the scatter about such a dependence counts. If the points of a pair agree that its exposures are wrong, it is
    registered well, too. Points with more than two observations are not judged.
    """
    observations = fitted.observations
    registered = np.ones(len(observations.starts), np.bool_)
    if not observations.in_pairs:
        return registered
    usable = np.flatnonzero(fitted.unclipped[0::2] & fitted.unclipped[1::2])
    latent = fitted.weighted[0]
    residual = latent.studentised[0::2]  # that of the second observation has the other sign
    number = observations.group_number[0::2]
    pairs = [usable[each] for each in members_of(number[usable]) if len(each) >= MISREGISTERED_FEWEST_POINTS]
    scatter = [robust_scale(residual[pair] - median(residual[pair])) for pair in pairs]
    limit = MISREGISTERED_SPREAD * float(np.quantile(scatter, USUAL_PAIRS)) if pairs else np.inf
    suspects = [pair for pair, own in zip(pairs, scatter, strict=True) if own > limit]
    if suspects:
        # Errors of the models are smooth in ln L, not in ln L over its standard deviation.
        covariates = _covariates(observations) / latent.sigma[0::2, None]
    for pair in suspects:
        common = abs(float(np.median(residual[pair])))
        if _unexplained(residual[pair], covariates[pair]) > max(limit, AGREEING_SHARE * common):
            registered[number == number[pair[0]]] = False
    return registered


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


def _covariates(observations: ExposedObservations) -> FloatArray:
    """Return what errors of the models depend on smoothly, one row per point, shape (points, 11)."""
    log_grey = np.log(np.maximum(observations.grey, DARKEST_GREY)).reshape(-1, 2).mean(axis=1)
    powers = log_grey[:, None] ** np.arange(4)
    positions = observations.position.reshape(-1, 4)  # of both observations
    squared_radii = np.sum(observations.position**2, axis=1).reshape(-1, 2)
    weight, grey = observations.surround_moments[:, 0, :2].T.astype(np.float64)
    log_surround = np.log(np.maximum(grey, DARKEST_GREY * weight) + np.finfo(np.float64).tiny)
    return np.hstack([powers, positions, squared_radii, np.diff(log_surround.reshape(-1, 2), axis=1)])


def _unexplained(residual: FloatArray, covariates: FloatArray) -> float:
    """Return the robust standard deviation of the residuals of a pair about a linear function of the covariates."""
    left = residual - median(residual)
    for _ in range(MISREGISTERED_ITERATIONS):
        root = np.sqrt(redescending_weights(left, np.ones(len(left), np.bool_))[0])
        left = residual - covariates @ np.linalg.lstsq(covariates * root[:, None], residual * root, rcond=None)[0]
    return robust_scale(left)
