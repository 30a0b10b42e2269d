"""The choice of the vignette and the effects that the observations show.

A decentred or non-radial vignette is chosen by an information criterion. Effects that cannot be told widen the
uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.effects import CONTRADICTIONS, CORRECTED, EFFECTS, Effects
from ospc.estimation.fit import Fit
from ospc.estimation.maximum_likelihood import MaximumLikelihoodEstimator
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.residual_effects import uneven_vignette, unsteadiness, unsteady_radiance
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.verdict import EffectEstimate
from ospc.settings.estimation import (
    ASYMMETRY_SIGMA,
    CONTRADICTING_SIGMAS,
    CONTRADICTION_PROBABILITY,
    EFFECT_PROBABILITY,
    FIRST_FIT_POINTS,
    MIN_GROUPS,
    MIN_GROUPS_TO_CONTRADICT,
    PREFERRED_SHARE,
    PROMISING_SHARE,
    SIGNIFICANT_SIGMAS,
    SIGNIFICANT_SIGMAS_IN_ALL,
    SUSPECTED_SIGMAS,
)

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
        if len(richer) <= len(fit.vignette_basis):
            continue
        added = len(richer) - len(fit.vignette_basis)
        estimator = MaximumLikelihoodEstimator(response, richer, noise, rounds, beside)
        if not supported(_glimpsed(observations, fit, estimator), added, PROMISING_SHARE):
            break
        wider = estimator.fit(observations, fit)
        if not supported(wider, added):
            break
        fit = wider
    return fit


def _glimpsed(observations: ExposedObservations, fit: Fit, estimator: MaximumLikelihoodEstimator) -> Fit:
    """Return what one step of Newton's method makes of a fit with further parameters of the vignette."""
    about = estimator.parameters_of(fit)
    equations = estimator.information(observations, fit, about).centred(about)
    prior = estimator.model.prior(about)
    found, chance = _step(equations, prior.precision(fit.hyperparameters), prior.mean)
    return replace(fit, vignette_basis=estimator.vignette_basis, parameters=found, chance=chance)


def _step(equations: NormalEquations, precision: FloatArray, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return parameters and their covariance by chance, given precision and mean of their prior."""
    scaled = equations.scaled(precision, equations.sandwich_factor)
    whole = scaled.information_scale * scaled.matrix + precision
    covariance = np.asarray(np.linalg.inv(whole), dtype=np.float64)
    return covariance @ (scaled.information_scale * scaled.vector + precision @ mean), covariance


def supported(fit: Fit, last: int, share: float = 1.0) -> bool:
    """Return whether the last ``last`` parameters of the vignette meet the criterion, or a share of it."""
    end = fit.vignette_part.stop
    part = slice(end - last, end)
    value = fit.parameters[part]
    covariance = fit.chance[part, part] + np.diag(_registration_sigma(fit)[-last:] ** 2)
    statistic = float(value @ np.linalg.solve(covariance, value))
    return bool(statistic > share * last * np.log(max(fit.groups, _FEWEST_GROUPS)))


def _registration_sigma(fit: Fit) -> FloatArray:
    """Return the standard deviation of each parameter of the vignette by errors that all pairs share, (len,)."""
    basis, parameters = fit.vignette_basis, fit.vignette_parameters
    sigma = np.full(len(basis), ASYMMETRY_SIGMA)
    if basis.free_centre:
        # A shift of the centre makes ln V asymmetric in proportion to its slope: a flat vignette has no centre.
        centre = slice(basis.radial, basis.radial + 2)
        radii = np.linspace(0, basis.usable_radius)
        along = basis.centre(parameters) + np.stack([radii, np.zeros_like(radii)], axis=1)
        slope = basis.jacobian(parameters, along)[:, basis.radial]
        sigma[centre] *= np.linalg.norm(radii) / max(float(np.linalg.norm(slope)), 1e-9)
    return sigma


def fit_with_chosen_effects(
    observations: ExposedObservations,
    response: ResponseBasis,
    widest: VignetteBasis,
    noise: NoiseModel | None,
    rounds: int,
) -> Fit:
    """Fit response and vignette, and those effects that the observations clearly show.

    One effect after the other is tried, the clearest first, and kept if it is significant by the scatter of the
    observations. As soon as something contradicts the model nothing is corrected: one effect imitates another. Few
    pairs of frames can contradict the model, but correct nothing. What any effect that is left out may amount to is
    added to the covariance. A camera at rest shows none. The parameters are as in :func:`fit_with_chosen_vignette`.
    """
    plain = fit_with_chosen_vignette(observations, response, widest, noise, rounds, Effects.none_of(observations))
    if not len(widest):
        return plain  # of a camera at rest, time, exposure and place of the few frames go together
    fit, untried = plain, _provable(plain.groups)
    plain_trials = trials = _tried(observations, fit, noise, tuple(EFFECTS))
    while suspect := _suspected(trials, untried):
        untried = tuple(name for name in untried if name != suspect.name)
        start = _one_step(fit, suspect)
        wider = MaximumLikelihoodEstimator(response, fit.vignette_basis, noise, rounds, start.effects).fit(
            observations, start
        )
        if not _accepted(wider):
            continue
        if suspect.name in CONTRADICTIONS:
            return _with_estimates(plain, plain_trials, _estimates(wider)[-1:])
        fit = fit_with_chosen_vignette(observations, response, widest, noise, rounds, start.effects)
        trials = _tried(observations, fit, noise, [other for other in EFFECTS if other not in fit.effects.chosen])
    if fit.groups < MIN_GROUPS_TO_CONTRADICT:
        return _with_estimates(fit, trials, ())
    residual = fit.residuals(observations)
    if unsteady := unsteadiness(residual, observations):
        return _with_estimates(plain, plain_trials, unsteady)
    uneven = uneven_vignette(residual, observations) or unsteady_radiance(fit.errors.radiance_sigma, fit.groups)
    return _with_estimates(fit, trials, (*_estimates(fit), *uneven))


@dataclass(frozen=True)
class _Trial:
    """What one step of Newton's method from a fit without an effect makes of it.

    ``sigma`` is the standard deviation of its value by chance; ``carried``, shape (p,), is how the parameters of the
    fit follow that of the effect. It is judged by ``groups`` groups of observations.
    """

    name: str
    value: float
    sigma: float
    carried: FloatArray
    groups: int

    @property
    def sigmas(self) -> float:
        """Distance from zero in standard deviations; 0 for a value that makes no sense."""
        return abs(self.value) / self.sigma_in_all if EFFECTS[self.name].allows(self.value) else 0.0

    @property
    def sigma_in_all(self) -> float:
        """Standard deviation by chance and by what other errors imitate."""
        return float(np.hypot(self.sigma, EFFECTS[self.name].systematic))

    @property
    def probability(self) -> float:
        """Probability that the effect is there, by the criterion of Schwarz (1978)."""
        before = CONTRADICTION_PROBABILITY if self.name in CONTRADICTIONS else EFFECT_PROBABILITY
        log_odds = np.log(before / (1 - before)) + (self.sigmas**2 - np.log(self.groups)) / 2
        return float(1 / (1 + np.exp(-log_odds)))

    @property
    def size_if_left_out(self) -> float:
        """Root mean square of what is missing in a fit without the effect.

        Every camera has a little of what can be corrected, within what chance hides. The value that the observations
        suggest, if it makes sense, counts by its probability.
        """
        hidden = 0.0 if self.name in CONTRADICTIONS else self.sigma
        suggested = self.value if EFFECTS[self.name].allows(self.value) else 0.0
        return float(np.hypot(hidden, np.sqrt(self.probability) * suggested))


def _tried(
    observations: ExposedObservations, fit: Fit, noise: NoiseModel | None, names: Sequence[str]
) -> list[_Trial]:
    """Return what the observations say about effects that a fit leaves out, about each as if it were the only one."""
    effects = fit.effects.and_(*names)
    estimator = MaximumLikelihoodEstimator(fit.response_basis, fit.vignette_basis, noise, effects=effects)
    p = len(fit.parameters)
    about = np.concatenate([fit.parameters, np.zeros(len(names))])
    equations = estimator.information(observations, fit, about).centred(about)
    prior = estimator.model.prior(about)
    precision = prior.precision(fit.hyperparameters)
    trials = []
    for i, name in enumerate(names):
        chosen = np.append(np.arange(p), p + i)
        found, covariance = _step(equations.part(chosen), precision[np.ix_(chosen, chosen)], prior.mean[chosen])
        carried = covariance[:p, p] / covariance[p, p]
        trials.append(_Trial(name, float(found[p]), float(np.sqrt(covariance[p, p])), carried, fit.groups))
    return trials


def _provable(groups: int) -> tuple[str, ...]:
    """Return the effects that so many groups of observations can prove."""
    if groups >= MIN_GROUPS:
        return tuple(EFFECTS)
    return CONTRADICTIONS if groups >= MIN_GROUPS_TO_CONTRADICT else ()


def _suspected(trials: Sequence[_Trial], untried: Sequence[str]) -> _Trial | None:
    """Return the clearest of the effects that were not tried, one of a camera where it is nearly so."""
    likely = [trial for trial in trials if trial.name in untried]
    threshold = max(SUSPECTED_SIGMAS, PREFERRED_SHARE * max((trial.sigmas for trial in likely), default=0.0))
    clear = [trial for trial in likely if trial.sigmas > threshold]
    return max(clear, key=lambda trial: (trial.name in CORRECTED, trial.sigmas), default=None)


def _one_step(fit: Fit, trial: _Trial) -> Fit:
    """Return where one step of Newton's method from a fit leads.

    A fit that starts without the effect can take more rounds than it has: its first weights discard as outliers what
    the effect would explain.
    """
    parameters = np.append(fit.parameters + trial.value * trial.carried, trial.value)
    effects = fit.effects.and_(trial.name)
    start = replace(fit, effects=effects, parameters=parameters)
    return replace(start, parameters=np.maximum(parameters, start.floor))


def _accepted(fit: Fit) -> bool:
    """Return whether the effect that was added last is significant, and all make sense."""
    by_chance, in_all = (_sigmas_of_last(fit, covariance) for covariance in (fit.chance, fit.covariance))
    significant = by_chance > SIGNIFICANT_SIGMAS and in_all > SIGNIFICANT_SIGMAS_IN_ALL
    if fit.effects.chosen[-1] in CONTRADICTIONS:
        # What contradicts the model also makes the halves disagree: by that scatter it would hide itself.
        significant |= by_chance > CONTRADICTING_SIGMAS
    values = zip(fit.effects.chosen, fit.effect_parameters, strict=True)
    return significant and all(EFFECTS[name].allows(value) for name, value in values)


def _sigmas_of_last(fit: Fit, covariance: FloatArray) -> float:
    """Return how far the effect that was added last is from zero, in standard deviations by a covariance."""
    systematic = EFFECTS[fit.effects.chosen[-1]].systematic
    return float(abs(fit.parameters[-1]) / np.hypot(np.sqrt(covariance[-1, -1]), systematic))


def _estimates(fit: Fit) -> tuple[EffectEstimate, ...]:
    sigma = np.sqrt(np.diag(fit.covariance))[fit.vignette_part.stop :]
    return tuple(
        EffectEstimate(name, float(value), float(deviation), name in CORRECTED, name in CONTRADICTIONS)
        for name, value, deviation in zip(fit.effects.chosen, fit.effect_parameters, sigma, strict=True)
    )


def _with_estimates(fit: Fit, trials: Sequence[_Trial], found: tuple[EffectEstimate, ...]) -> Fit:
    """Return a fit with the estimates of effects, and with a covariance that has those that are left out."""
    missing = [trial.size_if_left_out * _slope_of_left_out(fit, trial) for trial in trials]
    fit = _without_typical_light(fit)
    covariance = fit.covariance + sum(np.outer(one, one) for one in missing)
    estimates = (
        EffectEstimate(trial.name, trial.value, trial.sigma_in_all) for trial in trials if trial.name in CORRECTED
    )
    return replace(fit, covariance=covariance, effect_estimates=(*found, *estimates))


def _without_typical_light(fit: Fit) -> Fit:
    """Return a fit whose response holds no additional light."""

    def changed(parameters: FloatArray) -> FloatArray:
        return fit.effects.without_typical_light(fit.response_basis, parameters)[1]

    effects, parameters = fit.effects.without_typical_light(fit.response_basis, fit.parameters)
    if not len(effects):
        return replace(fit, effects=effects)
    from scipy.optimize import approx_fprime  # slow to import and rarely needed

    slope = approx_fprime(fit.parameters, changed)
    covariance, chance = (slope @ matrix @ slope.T for matrix in (fit.covariance, fit.chance))
    return replace(fit, effects=effects, parameters=parameters, covariance=covariance, chance=chance)


def _slope_of_left_out(fit: Fit, trial: _Trial) -> FloatArray:
    """Return how the parameters follow an effect that is left out, with a response that holds none of it, (p,)."""
    effects = fit.effects.and_(trial.name)

    def changed(value: float) -> FloatArray:
        parameters = np.append(fit.parameters + value * trial.carried, value)
        return effects.without_typical_light(fit.response_basis, parameters)[1][:-1]

    # A secant: near black ln g is far from linear in additional light.
    return (changed(trial.sigma) - changed(0.0)) / trial.sigma
