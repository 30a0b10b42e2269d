"""Detection of pairs of frames that were registered wrongly, from the residuals of a fit.

On a regular facade or a tiled floor, registration may be off by a whole window or tile, forward and back alike. The
two grey levels of a point are then those of different places, and their residuals scatter within the pair far more
than in others.
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray, members_of
from ospc.estimation.fitted import Fitted
from ospc.estimation.robust_weights import redescending_weights
from ospc.observations import ExposedObservations
from ospc.robust import median, robust_scale
from ospc.settings.error_model import DARKEST_GREY
from ospc.settings.residuals import (
    MISREGISTERED_FEWEST_POINTS,
    MISREGISTERED_ITERATIONS,
    MISREGISTERED_SPREAD,
    USUAL_PAIRS,
)


def registered_points(fitted: Fitted) -> BoolArray:
    """Return which points are in pairs that scatter like the others, given a fit to pairs, shape (points,).

    If response, vignette or effects are wrong, residuals vary smoothly with grey level, position and surroundings.
    Only the scatter about such a dependence counts.
    """
    observations, latent = fitted.observations, fitted.weighted[0]
    usable = fitted.unclipped[0::2] & fitted.unclipped[1::2]
    residual = latent.studentised[0::2]  # the second one is the same with the other sign
    number = observations.group_number[0::2]
    members = [np.flatnonzero(usable)[each] for each in members_of(number[usable])] if usable.any() else []
    judged = [each for each in members if len(each) >= MISREGISTERED_FEWEST_POINTS]
    scatter = np.array([robust_scale(residual[each] - median(residual[each])) for each in judged])
    registered = np.ones(len(number), np.bool_)
    if not judged:
        return registered
    limit = MISREGISTERED_SPREAD * np.quantile(scatter, USUAL_PAIRS)
    suspects = [each for each, own in zip(judged, scatter, strict=True) if own > limit]
    if suspects:
        covariates = _covariates(observations)
        wrong = [number[each[0]] for each in suspects if _unexplained(residual, covariates, each) > limit]
        registered = ~np.isin(number, wrong)
    return registered


def _covariates(observations: ExposedObservations) -> FloatArray:
    """Return what errors of the models depend on smoothly, one row per point, shape (points, 9)."""
    log_grey = np.log(np.maximum(observations.grey, DARKEST_GREY)).reshape(-1, 2).mean(axis=1)
    position = observations.position.reshape(-1, 2, 2)
    squared_radius = np.sum(position**2, axis=-1)
    around = observations.surround_moments[:, :2].reshape(-1, 2, 2).astype(np.float64)
    log_surround = np.log(np.maximum(around[..., 1], DARKEST_GREY * around[..., 0]) + np.finfo(np.float64).tiny)
    powers = log_grey[:, None] ** np.arange(4)
    changes = np.stack([np.diff(each, axis=1)[:, 0] for each in (squared_radius, log_surround)], axis=1)
    return np.hstack([powers, position.mean(axis=1), squared_radius.mean(axis=1)[:, None], changes])


def _unexplained(residual: FloatArray, covariates: FloatArray, members: IntArray) -> float:
    """Return the robust standard deviation of the residuals of a pair about a linear function of the covariates."""
    target, rows = residual[members], covariates[members]
    left = target - median(target)
    for _ in range(MISREGISTERED_ITERATIONS):
        root = np.sqrt(redescending_weights(left, np.ones(len(left), np.bool_))[0])
        left = target - rows @ np.linalg.lstsq(rows * root[:, None], target * root, rcond=None)[0]
    return robust_scale(left)
