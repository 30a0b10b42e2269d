"""The choice between radial, decentred and non-radial vignettes, by an information criterion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.estimation.maximum_likelihood import MaximumLikelihoodEstimator
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.settings.estimation import ASYMMETRY_SIGMA, FIRST_FIT_POINTS

_FEWEST_GROUPS = 3
"""Number of groups that the criterion is computed for at least: the logarithm of one or two is no penalty."""


def fit_with_chosen_vignette(  # noqa: PLR0917 (what is fitted, to what)
    observations: ExposedObservations,
    response: ResponseBasis,
    widest: VignetteBasis,
    noise: NoiseModel | None,
    rounds: int,
    effects: Effects | None = None,
) -> Fit:
    """Fit response and vignette, with no more vignette parameters than the data support.

    Starting from the purely radial model, first the free centre and then the non-radial terms are added, as long as
    the criterion of Schwarz (1978) is met: the joint Wald statistic of the added parameters, whose covariance
    includes correlated errors, must exceed their number times the logarithm of the number of groups.

    Parameters
    ----------
    observations
        The observations.
    response
        Basis of the response.
    widest
        The richest vignette considered.
    noise
        Noise of single pixels; None where the observations are single pixels themselves.
    rounds
        Most rounds of each fit after the first, convex one.
    effects
        What is fitted beside them; None for nothing.
    """
    beside = Effects() if effects is None else effects
    simplest = replace(widest, free_centre=False, non_radial=False)
    estimator = MaximumLikelihoodEstimator(response, simplest, noise, rounds, beside)
    # A part of the points already gives most of the solution; only the last rounds need all of them.
    step = len(observations.starts) // FIRST_FIT_POINTS
    start = estimator.fit(observations.of_points(slice(None, None, step))) if step > 1 else None
    fit = estimator.fit(observations, start)
    for richer in (replace(simplest, free_centre=True), widest):
        if richer == fit.vignette_basis or len(richer) <= len(fit.vignette_basis):
            continue
        wider = MaximumLikelihoodEstimator(response, richer, noise, rounds, beside).fit(observations, fit)
        if not supported(wider, len(richer) - len(fit.vignette_basis)):
            break
        fit = wider
    return fit


def supported(fit: Fit, last: int) -> bool:
    """Return whether the last ``last`` parameters of the vignette meet the criterion of Schwarz (1978)."""
    end = fit.vignette_part.stop
    part = slice(end - last, end)
    value = fit.parameters[part]
    covariance = fit.chance[part, part] + ASYMMETRY_SIGMA**2 * np.eye(last)
    statistic = float(value @ np.linalg.solve(covariance, value))
    return bool(statistic > last * np.log(max(fit.groups, _FEWEST_GROUPS)))
