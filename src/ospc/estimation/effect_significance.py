"""Significance of fitted effects, and fits without the insignificant ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.effect_models import CONTRADICTIONS, EFFECTS
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.fitted import Fitted
from ospc.settings.effects import CONTRADICTING_SIGMAS, SIGNIFICANT_SIGMAS, SIGNIFICANT_SIGMAS_IN_ALL


def only_significant(fitted: Fitted, plan: FitPlan) -> Fitted:
    """Return a fit without the effects that are not significant beside the others."""
    fit = fitted.fit
    while (dropped := first_to_drop(fit)) is not None:
        kept = tuple(name for i, name in enumerate(fit.effects.chosen) if i != dropped)
        parameters = np.delete(fit.parameters, fit.vignette_part.stop + dropped)
        start = replace(fit, effects=replace(fit.effects, chosen=kept), parameters=parameters)
        fit = plan.refit(fitted.observations, start)
    return replace(fitted, fit=fit)


def first_to_drop(fit: Fit) -> int | None:
    """Return the number of the weakest effect that is implausible or, if there is none, not significant."""
    doubtful = _implausible(fit) or [i for i in range(len(fit.effects)) if not is_significant(fit, i)]
    return min(doubtful, key=lambda i: _sigmas_of(fit, i, fit.chance), default=None)


def _implausible(fit: Fit) -> list[int]:
    """Return the numbers of the effects whose values are not plausible."""
    values = zip(fit.effects.chosen, fit.effect_parameters, strict=True)
    return [i for i, (name, value) in enumerate(values) if not EFFECTS[name].allows(value)]


def is_significant(fit: Fit, number: int) -> bool:
    """Return whether an effect is significant and all effects are plausible."""
    by_chance, in_all = (_sigmas_of(fit, number, covariance) for covariance in (fit.chance, fit.covariance))
    if fit.effects.chosen[number] in CONTRADICTIONS:
        # A contradiction also makes the halves disagree: that counts half.
        significant = math.sqrt(by_chance * in_all) > CONTRADICTING_SIGMAS
    else:
        significant = by_chance > SIGNIFICANT_SIGMAS
    significant &= in_all > SIGNIFICANT_SIGMAS_IN_ALL
    return significant and not _implausible(fit)


def _sigmas_of(fit: Fit, number: int, covariance: FloatArray) -> float:
    """Return the distance of an effect from zero, in standard deviations given a covariance."""
    systematic, variance = EFFECTS[fit.effects.chosen[number]].systematic, np.diag(covariance)[-len(fit.effects) :]
    return float(abs(fit.effect_parameters[number]) / np.hypot(np.sqrt(variance[number]), systematic))
