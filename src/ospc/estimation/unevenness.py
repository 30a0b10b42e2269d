"""Whether parts of the image are darker or brighter than a smooth vignette: dirt, scratches, shading correction."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri, stdtr

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.observations import ExposedObservations
from ospc.photometry.effect_estimate import EffectEstimate
from ospc.robust import robust_scale
from ospc.settings.estimation import (
    UNEVEN_CELLS,
    UNEVEN_FEWEST,
    UNEVEN_FEWEST_BLOCKS,
    UNEVEN_GROUPS_PER_BLOCK,
    UNEVEN_SIGMAS,
    UNEVEN_SYSTEMATIC,
    WEIGHT_CUT_SIGMAS,
)

UNEVEN = "uneven vignette"
"""Name of the finding."""


def uneven_vignette(residual: FloatArray, observations: ExposedObservations) -> tuple[EffectEstimate, ...]:
    """Return the part of the image that a smooth vignette explains least; nothing if all are explained.

    Its value is ln of its brightness over that of the vignette: twice the mean residual, because a residual is
    relative to the mean of two observations.

    Parameters
    ----------
    residual
        The :meth:`~ospc.estimation.fit.Fit.residuals` of a fit.
    observations
        What it was made of.
    """
    known = np.isfinite(residual)
    if not known.any():
        return ()
    limit = WEIGHT_CUT_SIGMAS * robust_scale(residual[known])
    residual = np.clip(residual, -limit, limit)
    part = _part(observations)
    means = (_mean(residual, observations, known & (part == number)) for number in range(np.prod(UNEVEN_CELLS)))
    found = [one for one in means if one is not None]
    if not found:
        return ()
    mean, sigma, freedom = np.array(found).T
    # The scatter between few blocks is itself uncertain: the normal deviate that is as improbable is smaller.
    sigmas = -ndtri(stdtr(freedom, -np.abs(mean) / np.hypot(sigma, UNEVEN_SYSTEMATIC)))
    worst = int(np.argmax(sigmas))
    if sigmas[worst] < UNEVEN_SIGMAS:
        return ()
    return (EffectEstimate(UNEVEN, 2 * float(mean[worst]), 2 * float(sigma[worst]), contradicts=True),)


def _part(observations: ExposedObservations) -> IntArray:
    """Return the number of the part of the image that each observation is in, shape (n,)."""
    extent = np.abs(observations.position).max(axis=0)
    place = np.clip((observations.position / extent + 1) / 2 * UNEVEN_CELLS, 0, np.array(UNEVEN_CELLS) - 1)
    return np.asarray(place.astype(np.int64) @ [1, UNEVEN_CELLS[0]])


def _mean(
    residual: FloatArray, observations: ExposedObservations, inside: BoolArray
) -> tuple[float, float, float] | None:
    """Return the mean residual, its standard deviation by the scatter between blocks, and the degrees of freedom."""
    _, block = np.unique(observations.group[inside] // UNEVEN_GROUPS_PER_BLOCK, return_inverse=True)
    count = np.bincount(block).astype(np.float64)
    if count.sum() < UNEVEN_FEWEST or len(count) < UNEVEN_FEWEST_BLOCKS:
        return None
    mean = residual[inside].mean()
    deviation = np.bincount(block, residual[inside] - mean)
    sigma = np.sqrt(np.sum(deviation**2) * len(count) / (len(count) - 1)) / count.sum()
    return float(mean), float(sigma), float(count.sum() ** 2 / np.sum(count**2) - 1)
