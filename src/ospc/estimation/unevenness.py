"""Whether parts of the image are darker or brighter than a smooth vignette: dirt, scratches, shading correction."""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.estimation.fit import Fit
from ospc.estimation.robust import robust_scale
from ospc.observations import ExposedObservations
from ospc.photometry.effect_estimate import EffectEstimate
from ospc.settings.estimation import (
    GROUPS_PER_BLOCK,
    UNEVEN_FEWEST,
    UNEVEN_GRIDS,
    UNEVEN_SIGMAS,
    UNEVEN_SYSTEMATIC,
    WEIGHT_CUT_SIGMAS,
)

UNEVEN = "uneven vignette"
"""Name of the finding."""


def uneven_vignette(fit: Fit, observations: ExposedObservations) -> tuple[EffectEstimate, ...]:
    """Return the part of the image that a smooth vignette explains least; nothing if all are explained.

    Its value is ln of its brightness over that of the vignette: twice the mean residual, because a residual is
    relative to the mean of two observations.

    Parameters
    ----------
    fit
        A fit.
    observations
        What it was made of.
    """
    residual = fit.residuals(observations)
    known = np.isfinite(residual)
    if not known.any():
        return ()
    limit = WEIGHT_CUT_SIGMAS * robust_scale(residual[known])
    residual = np.clip(residual, -limit, limit)
    found = [part for across, down in UNEVEN_GRIDS for part in _parts(residual, observations, known, across, down)]
    if not found:
        return ()
    mean, sigma = np.array(found).T
    sigmas = np.abs(mean) / np.hypot(sigma, UNEVEN_SYSTEMATIC)
    worst = int(np.argmax(sigmas))
    if sigmas[worst] < UNEVEN_SIGMAS:
        return ()
    return (EffectEstimate(UNEVEN, 2 * float(mean[worst]), 2 * float(sigma[worst]), contradicts=True),)


def _parts(
    residual: FloatArray, observations: ExposedObservations, known: BoolArray, across: int, down: int
) -> list[tuple[float, float]]:
    """Return the mean residual in each part of the image that has enough of them, with its standard deviation."""
    extent = np.abs(observations.position).max(axis=0)
    place = np.clip((observations.position / extent + 1) / 2 * (across, down), 0, np.array([across, down]) - 1)
    part = place.astype(np.int64) @ [1, across]
    found = (_mean(residual, observations, known & (part == number)) for number in range(across * down))
    return [one for one in found if one is not None]


def _mean(residual: FloatArray, observations: ExposedObservations, inside: BoolArray) -> tuple[float, float] | None:
    """Return the mean residual and its standard deviation by the scatter between blocks of groups, or nothing."""
    _, block = np.unique(observations.group[inside] // GROUPS_PER_BLOCK, return_inverse=True)
    count = np.bincount(block)
    if count.sum() < UNEVEN_FEWEST or len(count) < 2:
        return None
    mean = residual[inside].mean()
    deviation = np.bincount(block, residual[inside] - mean)
    return float(mean), float(np.sqrt(np.sum(deviation**2) * len(count) / (len(count) - 1)) / count.sum())
