"""Estimates of effects that a fit leaves out: by a single Newton step from it, or by a joint fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.effect_models import (
    CONTRADICTIONS,
    CORRECTED,
    DRIFTING_BLACK,
    DRIFTING_RESPONSE,
    DRIFTING_VIGNETTE,
    EFFECTS,
)
from ospc.estimation.fit import Fit
from ospc.estimation.fitted import Fitted
from ospc.estimation.model import Model
from ospc.settings.effects import (
    CONTRADICTION_PROBABILITY,
    EFFECT_PROBABILITY,
    PREFERRED_SHARE,
    SUSPECTED_LIGHT_SIGMAS,
    SUSPECTED_SIGMAS,
)


@dataclass(frozen=True)
class Trial:
    """The estimate of an effect that a fit leaves out."""

    name: str
    """The effect."""
    value: float
    """Value of its parameter."""
    sigma: float
    """Standard deviation of the parameter due to chance."""
    parameter_slope: FloatArray
    """Derivative of the p parameters of the fit with respect to that of the effect, shape (p,)."""
    groups: int
    """Number of groups of observations."""

    @property
    def sigmas(self) -> float:
        """Distance from zero in standard deviations; 0 if the value is implausible."""
        return self._over(self.total_sigma)

    @property
    def sigmas_by_chance(self) -> float:
        """Distance from zero in standard deviations due to chance alone; 0 if the value is implausible."""
        return self._over(self.sigma)

    def _over(self, sigma: float) -> float:
        return abs(self.value) / sigma if EFFECTS[self.name].allows(self.value) else 0.0

    @property
    def total_sigma(self) -> float:
        """Standard deviation due to chance and to other errors that imitate the effect."""
        return float(np.hypot(self.sigma, EFFECTS[self.name].systematic))

    @property
    def probability(self) -> float:
        """Posterior probability of the effect, by the criterion of Schwarz (1978)."""
        before = CONTRADICTION_PROBABILITY if self.name in CONTRADICTIONS else EFFECT_PROBABILITY
        before /= EFFECTS[self.name].alternatives
        log_odds = np.log(before / (1 - before)) + (self.sigmas**2 - np.log(self.groups)) / 2
        return float(1 / (1 + np.exp(-log_odds)))

    @property
    def size_if_left_out(self) -> float:
        """Root mean square of the effect's parameter, as the error of a fit without it.

        Either the effect exists, with about the observed value if that is plausible, or it is as small as usual, or
        smaller if the observations indicate this.
        """
        effect, probability = EFFECTS[self.name], self.probability
        if_there = self.sigma**2 + (self.value**2 if effect.allows(self.value) else 0.0)
        if_not = self.sigma**2 * effect.usual_sigma**2 / (self.sigma**2 + effect.usual_sigma**2)
        return float(np.sqrt(probability * if_there + (1 - probability) * if_not))


def estimate_effects(fitted: Fitted, names: Sequence[str]) -> list[Trial]:
    """Return the one-step estimate of each of several effects that a fit leaves out, as if it were the only one."""
    model, about = _with_all(fitted.fit, names)
    p = len(fitted.fit.parameters)
    choices = [np.append(np.arange(p), p + i) for i in range(len(names))]
    steps = fitted.newton_steps(model, about, choices)
    return [_trial(name, *step, fitted.fit.groups) for name, step in zip(names, steps, strict=True)]


def suspected(trials: Sequence[Trial], untried: Sequence[str]) -> Trial | None:
    """Return the clearest untried effect; effects of a camera are preferred if they are nearly as clear."""
    likely = [trial for trial in trials if trial.name in untried]
    clearest = PREFERRED_SHARE * max((trial.sigmas for trial in likely), default=0.0)
    clear = [trial for trial in likely if trial.sigmas > max(_limit(trial, SUSPECTED_SIGMAS), clearest)]
    if not clear:
        light = (trial for trial in likely if EFFECTS[trial.name].adds == "light")
        clear = [trial for trial in light if trial.sigmas_by_chance > _limit(trial, SUSPECTED_LIGHT_SIGMAS)]
    return max(clear, key=lambda trial: (trial.name in CORRECTED, trial.sigmas), default=None)


def _limit(trial: Trial, sigmas: float) -> float:
    """Return the significance that an effect exceeds as rarely as a single one exceeds ``sigmas``."""
    return math.sqrt(sigmas**2 + 2 * math.log(EFFECTS[trial.name].alternatives))


def trial_of(fit: Fit) -> Trial:
    """Return the estimate of the last effect of a joint fit, which is left out because it is not significant."""
    return _trial(fit.effects.chosen[-1], fit.parameters, fit.chance, fit.groups)


def _trial(name: str, parameters: FloatArray, covariance: FloatArray, groups: int) -> Trial:
    """Return the estimate of the effect whose parameter is the last one."""
    variance = covariance[-1, -1]
    return Trial(name, float(parameters[-1]), float(np.sqrt(variance)), covariance[:-1, -1] / variance, groups)


def after_newton_step(fit: Fit, trial: Trial) -> Fit:
    """Return the fit after the Newton step, as the start of a fit with the effect.

    A fit that starts without the effect would not converge within its rounds: its first weights discard the
    observations explained by the effect as outliers.
    """
    parameters = np.append(fit.parameters + trial.value * trial.parameter_slope, trial.value)
    return _including(fit, [trial.name], parameters)


def after_joint_newton_step(fitted: Fitted, names: Sequence[str]) -> Fit:
    """Return the fit after the Newton step with several effects, as the start of a fit with all of them."""
    model, about = _with_all(fitted.fit, names)
    ((parameters, _),) = fitted.newton_steps(model, about, [np.arange(len(about))])
    return _including(fitted.fit, names, parameters)


def _with_all(fit: Fit, names: Sequence[str]) -> tuple[Model, FloatArray]:
    """Return the model with further effects, and the fit in its parameters."""
    model = Model(fit.response_basis, fit.vignette_basis, fit.effects.including(*names))
    return model, np.concatenate([fit.parameters, np.zeros(len(names))])


def _including(fit: Fit, names: Sequence[str], parameters: FloatArray) -> Fit:
    """Return the fit with further effects, and the parameters with theirs, as far as they are possible."""
    start = replace(fit, effects=fit.effects.including(*names), parameters=parameters)
    return replace(start, parameters=np.maximum(parameters, start.floor))


def slope_of_left_out(fit: Fit, trial: Trial) -> FloatArray:
    """Return how the parameters change per unit of an effect that is left out, for a response free of it."""
    effects = fit.effects.including(trial.name)

    def changed(value: float) -> FloatArray:
        parameters = np.append(fit.parameters + value * trial.parameter_slope, value)
        return effects.without_absorbed_light(fit.response_basis, parameters)[1][:-1]

    # A secant, because ln g near black is far from linear in additional light.
    return (changed(trial.sigma) - changed(0.0)) / trial.sigma


def change_until_end(fit: Fit, trial: Trial) -> FloatArray:
    """Return how the last frame's curves differ from the mean ones, per unit of an effect, shape (p,).

    It is zero unless the effect changes with time.
    """
    change = np.zeros_like(fit.parameters)
    gamma, knots = fit.response_parameters, fit.response_basis.knots
    slopes = slice(fit.vignette_part.start, fit.vignette_part.start + fit.vignette_basis.radial)
    if trial.name == DRIFTING_RESPONSE:
        change[: len(gamma)] = gamma
    elif trial.name == DRIFTING_BLACK:
        change[: len(gamma)] = -gamma / np.maximum(knots, knots[1])
    elif trial.name == DRIFTING_VIGNETTE:
        change[slopes] = 1
    return change
