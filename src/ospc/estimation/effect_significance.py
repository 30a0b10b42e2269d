"""Significance of fitted effects, and fits without the insignificant ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.effect_models import CONTRADICTIONS, EFFECTS
from ospc.estimation.effect_trials import after_joint_newton_step
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.fitted import Fitted
from ospc.estimation.vignette_choice import with_vignette_chosen_again
from ospc.settings.effects import CONTRADICTING_SIGMAS, SIGNIFICANT_SIGMAS, SIGNIFICANT_SIGMAS_IN_ALL


def with_significant(plain: Fitted, names: Sequence[str], plan: FitPlan) -> Fitted:
    """Return a fit with further effects, of those named, that are all significant beside each other."""
    while names:
        # From the same start each time: the result does not depend on the effects that were dropped.
        fit = plan.refit(plain.observations, after_joint_newton_step(plain, names))
        if _first_to_drop(fit) is None:
            return with_vignette_chosen_again(replace(plain, fit=fit), plan)
        while (dropped := _first_to_drop(fit)) is not None:
            fit = _without(fit, dropped)
        names = fit.effects.chosen
    return plain


def _without(fit: Fit, number: int) -> Fit:
    """Return the fit if one of its effects is zero, to first order."""
    chosen = tuple(name for i, name in enumerate(fit.effects.chosen) if i != number)
    number += fit.vignette_part.stop
    project = np.delete(np.eye(len(fit.parameters)), number, axis=0)
    project[:, number] = -(project @ fit.chance[:, number]) / fit.chance[number, number]
    covariance, chance = (project @ matrix @ project.T for matrix in (fit.covariance, fit.chance))
    kept = replace(fit, effects=replace(fit.effects, chosen=chosen), covariance=covariance, chance=chance)
    return replace(kept, parameters=np.maximum(project @ fit.parameters, kept.floor))


def without_insignificant(fitted: Fitted, start: Fitted, plan: FitPlan) -> Fitted:
    """Return a fit whose effects are all significant beside each other, from a start without any if some are not."""
    if _first_to_drop(fitted.fit) is None:
        return fitted
    return with_significant(start, fitted.fit.effects.chosen, plan)


def _first_to_drop(fit: Fit) -> int | None:
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
