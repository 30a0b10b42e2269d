"""The choice of the effects that the observations show; those that they cannot tell widen the uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import approx_fprime

from ospc.arrays import FloatArray
from ospc.estimation.effects import CONTRADICTIONS, CORRECTED, EFFECTS, Effects
from ospc.estimation.fit import Fit
from ospc.estimation.maximum_likelihood import MaximumLikelihoodEstimator
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.unevenness import uneven_vignette
from ospc.estimation.unsteadiness import unsteadiness
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.observations import ExposedObservations
from ospc.photometry.effect_estimate import EffectEstimate
from ospc.photometry.noise import NoiseModel
from ospc.settings.estimation import (
    CONTRADICTING_SIGMAS,
    MIN_GROUPS,
    MIN_GROUPS_TO_CONTRADICT,
    PREFERRED_SHARE,
    SIGNIFICANT_SIGMAS,
    SIGNIFICANT_SIGMAS_IN_ALL,
    SUSPECTED_SIGMAS,
)


def fit_with_chosen_effects(
    observations: ExposedObservations,
    response: ResponseBasis,
    widest: VignetteBasis,
    noise: NoiseModel | None,
    rounds: int,
) -> Fit:
    """Fit response and vignette, and those effects that the observations clearly show.

    One effect after the other is tried, the clearest first, and kept if it is significant by the scatter of the
    observations. As soon as something contradicts the model nothing is corrected: one effect imitates another. What
    the effects that are left out may amount to is added to the covariance. A camera at rest shows none.

    Parameters
    ----------
    observations, response, widest, noise, rounds
        As for :func:`~ospc.estimation.vignette_choice.fit_with_chosen_vignette`.
    """
    plain = fit_with_chosen_vignette(observations, response, widest, noise, rounds, Effects.none_of(observations))
    if not len(widest):
        return plain  # of a camera at rest, time, exposure and place of the few frames go together
    fit, possible = plain, _possible(plain.groups)
    refused: list[str] = []
    plain_trials = trials = tried(observations, fit, noise, tuple(EFFECTS))
    while name := _suspected(trials, possible):
        possible = tuple(other for other in possible if other != name)
        effects = fit.effects.and_(name)
        estimator = MaximumLikelihoodEstimator(response, fit.vignette_basis, noise, rounds, effects)
        wider = estimator.fit(observations, fit)
        if not _accepted(wider):
            refused.append(name)
            continue
        if name in CONTRADICTIONS:
            return _with_estimates(plain, plain_trials, _estimates(wider)[-1:], refused)
        fit = fit_with_chosen_vignette(observations, response, widest, noise, rounds, effects)
        trials = tried(observations, fit, noise, [other for other in EFFECTS if other not in effects.chosen])
    if fit.groups < MIN_GROUPS:
        return _with_estimates(fit, trials, (), refused)
    residual = fit.residuals(observations)
    if unsteady := unsteadiness(residual, observations):
        return _with_estimates(plain, plain_trials, unsteady, refused)
    return _with_estimates(fit, trials, (*_estimates(fit), *uneven_vignette(residual, observations)), refused)


@dataclass(frozen=True)
class Trial:
    """What one step of Newton's method from a fit without an effect makes of it.

    Attributes
    ----------
    name
        Name of the effect.
    value, sigma
        Its parameter, and the standard deviation by chance.
    carried
        How the parameters of the fit follow that of the effect, shape (p,).
    """

    name: str
    value: float
    sigma: float
    carried: FloatArray

    @property
    def sigmas(self) -> float:
        """Distance from zero in standard deviations; 0 for a value that makes no sense."""
        return abs(self.value) / self.sigma_in_all if EFFECTS[self.name].allows(self.value) else 0.0

    @property
    def sigma_in_all(self) -> float:
        """Standard deviation by chance and by what other errors imitate."""
        return float(np.hypot(self.sigma, EFFECTS[self.name].systematic))


def tried(observations: ExposedObservations, fit: Fit, noise: NoiseModel | None, names: Sequence[str]) -> list[Trial]:
    """Return what the observations say about effects that a fit leaves out, about each as if it were the only one."""
    estimator = MaximumLikelihoodEstimator(
        fit.response_basis, fit.vignette_basis, noise, effects=fit.effects.and_(*names)
    )
    p = len(fit.parameters)
    about = np.concatenate([fit.parameters, np.zeros(len(names))])
    equations = estimator.information(observations, fit, about).centred(about)
    prior = estimator.prior(about)
    precision = prior.precision(fit.hyperparameters)
    trials = []
    for i, name in enumerate(names):
        chosen = np.append(np.arange(p), p + i)
        own = precision[np.ix_(chosen, chosen)]
        part = equations.part(chosen).scaled(own, equations.sandwich_factor)
        whole = part.information_scale * part.matrix + own
        inverse = np.linalg.inv(whole)
        found = inverse @ (part.information_scale * part.vector + own @ prior.mean[chosen])
        carried = -np.linalg.solve(whole[:p, :p], whole[:p, p])
        trials.append(Trial(name, float(found[p]), float(np.sqrt(inverse[p, p])), carried))
    return trials


def _possible(groups: int) -> tuple[str, ...]:
    """Return the effects that so many groups of observations can show."""
    if groups >= MIN_GROUPS:
        return tuple(EFFECTS)
    return CONTRADICTIONS if groups >= MIN_GROUPS_TO_CONTRADICT else ()


def _suspected(trials: Sequence[Trial], possible: Sequence[str]) -> str:
    """Return the clearest of the possible effects, one of a camera where it is nearly so; empty if none is clear."""
    clear = {trial.name: trial.sigmas for trial in trials if trial.name in possible}
    threshold = max(SUSPECTED_SIGMAS, PREFERRED_SHARE * max(clear.values(), default=0.0))
    clear = {name: sigmas for name, sigmas in clear.items() if sigmas > threshold}
    return max(clear, key=lambda name: (name in CORRECTED, clear[name]), default="")


def _accepted(fit: Fit) -> bool:
    """Return whether the effect that was added last is significant, and all make sense."""
    effect, value = EFFECTS[fit.effects.chosen[-1]], float(fit.parameters[-1])
    by_chance, in_all = (
        float(np.hypot(np.sqrt(matrix[-1, -1]), effect.systematic)) for matrix in (fit.chance, fit.covariance)
    )
    significant = abs(value) > max(SIGNIFICANT_SIGMAS * by_chance, SIGNIFICANT_SIGMAS_IN_ALL * in_all)
    if fit.effects.chosen[-1] in CONTRADICTIONS:
        # What contradicts the model also makes the halves disagree: by that scatter it would hide itself.
        significant |= abs(value) > CONTRADICTING_SIGMAS * by_chance
    values = zip(fit.effects.chosen, fit.effect_parameters, strict=True)
    return significant and all(EFFECTS[name].allows(value) for name, value in values)


def _estimates(fit: Fit) -> tuple[EffectEstimate, ...]:
    """Return the estimates of the effects of a fit."""
    sigma = np.sqrt(np.diag(fit.covariance))[len(fit.parameters) - len(fit.effects) :]
    return tuple(
        EffectEstimate(name, float(value), float(deviation), name in CORRECTED, name in CONTRADICTIONS)
        for name, value, deviation in zip(fit.effects.chosen, fit.effect_parameters, sigma, strict=True)
    )


def _with_estimates(
    fit: Fit, trials: Sequence[Trial], found: tuple[EffectEstimate, ...], refused: Sequence[str]
) -> Fit:
    """Return a fit with the estimates of effects, and with a covariance that has those that are left out.

    An effect that was suspected and refused may be there all the same, as large as it seems.
    """
    left_out = [trial for trial in trials if trial.name in CORRECTED or trial.name in refused]
    slopes = [_slope_of_left_out(fit, trial) for trial in left_out]
    sizes = [np.hypot(trial.sigma, trial.value if trial.name in refused else 0.0) for trial in left_out]
    fit = _without_typical_light(fit)
    covariance = fit.covariance + sum(
        size**2 * np.outer(slope, slope) for size, slope in zip(sizes, slopes, strict=True)
    )
    estimates = (
        EffectEstimate(trial.name, trial.value, trial.sigma_in_all) for trial in left_out if trial.name in CORRECTED
    )
    return replace(fit, covariance=covariance, effect_estimates=(*found, *estimates))


def _without_typical_light(fit: Fit) -> Fit:
    """Return a fit whose response holds no additional light."""

    def changed(parameters: FloatArray) -> FloatArray:
        return fit.effects.without_typical_light(fit.response_basis, parameters)[1]

    effects, parameters = fit.effects.without_typical_light(fit.response_basis, fit.parameters)
    if not len(effects):
        return replace(fit, effects=effects)
    slope = approx_fprime(fit.parameters, changed)
    return replace(
        fit,
        effects=effects,
        parameters=parameters,
        covariance=slope @ fit.covariance @ slope.T,
        chance=slope @ fit.chance @ slope.T,
    )


def _slope_of_left_out(fit: Fit, trial: Trial) -> FloatArray:
    """Return how the parameters follow an effect that is left out, with a response that holds none of it, (p,)."""
    effects = fit.effects.and_(trial.name)

    def changed(value: FloatArray) -> FloatArray:
        parameters = np.append(fit.parameters + value[0] * trial.carried, value)
        return effects.without_typical_light(fit.response_basis, parameters)[1][:-1]

    # A secant: near black ln g is far from linear in additional light.
    return np.asarray(approx_fprime(np.zeros(1), changed, trial.sigma)).reshape(-1)
