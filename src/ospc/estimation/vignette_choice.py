"""How rich a vignette the data ask for, chosen by information."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ospc.estimation.fit import Fit
from ospc.estimation.maximum_likelihood import MaximumLikelihoodEstimator
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import Observations
from ospc.photometry.noise import NoiseModel

_SYSTEMATIC = 0.004
"""Errors of registration common to all samples imitate asymmetries of this size, in ln V over a half diagonal."""

_FIRST_POINTS = 10_000


def fit_with_chosen_vignette(
    observations: Observations, response: ResponseBasis, widest: VignetteBasis, noise: NoiseModel | None, rounds: int
) -> Fit:
    """Fit response and vignette, with only as many vignette parameters as the data ask for.

    From the widest model on, the non-radial part and then the free centre are given up where the criterion of Schwarz
    (1978) says so: their joint Wald statistic, which has the covariance of correlated errors in it, is compared with
    their number times the logarithm of the number of groups.

    Parameters
    ----------
    observations
        What was seen.
    response
        Basis of the response.
    widest
        The richest vignette considered.
    noise
        Noise of single pixels; None where the observations are single pixels themselves.
    rounds
        Rounds of each fit.
    """
    simplest = replace(widest, free_centre=False, non_radial=False)
    estimator = MaximumLikelihoodEstimator(response, simplest, noise, rounds)
    # Most of the way to the solution is gone with a part of the points; the last rounds are for all of them.
    step = len(observations.starts) // _FIRST_POINTS
    start = estimator.fit(observations.of_points(slice(None, None, step))) if step > 1 else None
    fit = estimator.fit(observations, start)
    for richer in (replace(simplest, free_centre=True), widest):
        if richer == fit.vignette_basis or len(richer) <= len(fit.vignette_basis):
            continue
        wider = MaximumLikelihoodEstimator(response, richer, noise, rounds).fit(observations, fit)
        if not asked_for(wider, len(richer) - len(fit.vignette_basis)):
            break
        fit = wider
    return fit


def asked_for(fit: Fit, last: int) -> bool:
    """Return whether the last so many parameters are worth their number."""
    value = fit.parameters[-last:]
    covariance = fit.covariance[-last:, -last:] + _SYSTEMATIC**2 * np.eye(last)
    statistic = float(value @ np.linalg.solve(covariance, value))
    return bool(statistic > last * np.log(max(fit.groups, 3)))
