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
    DOUBTED_SIGMAS,
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
    pairs of frames can contradict the model, but correct nothing. What the effects that are left out may amount to is
    added to the covariance. A camera at rest shows none. The parameters are as in :func:`fit_with_chosen_vignette`.
    """
    plain = fit_with_chosen_vignette(observations, response, widest, noise, rounds, Effects.none_of(observations))
    if not len(widest):
        return plain  # of a camera at rest, time, exposure and place of the few frames go together
    provable = _provable(plain.groups)
    fit, possible = plain, tuple(name for name in EFFECTS if name in CORRECTED or name in provable)
    refused: list[str] = []
    plain_trials = trials = _tried(observations, fit, noise, tuple(EFFECTS))
    while name := _suspected(trials, possible):
        possible = tuple(other for other in possible if other != name)
        effects = fit.effects.and_(name)
        wider = MaximumLikelihoodEstimator(response, fit.vignette_basis, noise, rounds, effects).fit(
            observations, fit
        )
        if name not in provable or not _accepted(wider):
            if _remains_possible(wider, provable):
                refused.append(name)
            continue
        if name in CONTRADICTIONS:
            return _with_estimates(plain, plain_trials, _estimates(wider)[-1:], refused)
        fit = fit_with_chosen_vignette(observations, response, widest, noise, rounds, effects)
        trials = _tried(observations, fit, noise, [other for other in EFFECTS if other not in effects.chosen])
    if fit.groups < MIN_GROUPS_TO_CONTRADICT:
        return _with_estimates(fit, trials, (), refused)
    residual = fit.residuals(observations)
    if unsteady := unsteadiness(residual, observations):
        return _with_estimates(plain, plain_trials, unsteady, refused)
    uneven = uneven_vignette(residual, observations) or unsteady_radiance(fit.errors.radiance_sigma, fit.groups)
    return _with_estimates(fit, trials, (*_estimates(fit), *uneven), refused)


@dataclass(frozen=True)
class _Trial:
    """What one step of Newton's method from a fit without an effect makes of it.

    ``sigma`` is the standard deviation of its value by chance; ``carried``, shape (p,), is how the parameters of the
    fit follow that of the effect.
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
        trials.append(_Trial(name, float(found[p]), float(np.sqrt(covariance[p, p])), carried))
    return trials


def _provable(groups: int) -> tuple[str, ...]:
    """Return the effects that so many groups of observations can prove."""
    if groups >= MIN_GROUPS:
        return tuple(EFFECTS)
    return CONTRADICTIONS if groups >= MIN_GROUPS_TO_CONTRADICT else ()


def _suspected(trials: Sequence[_Trial], possible: Sequence[str]) -> str:
    """Return the clearest of the possible effects, one of a camera where it is nearly so; empty if none is clear."""
    clear = {trial.name: trial.sigmas for trial in trials if trial.name in possible}
    threshold = max(SUSPECTED_SIGMAS, PREFERRED_SHARE * max(clear.values(), default=0.0))
    clear = {name: sigmas for name, sigmas in clear.items() if sigmas > threshold}
    return max(clear, key=lambda name: (name in CORRECTED, clear[name]), default="")


def _accepted(fit: Fit) -> bool:
    """Return whether the effect that was added last is significant, and all make sense."""
    by_chance, in_all = (_sigmas_of_last(fit, covariance) for covariance in (fit.chance, fit.covariance))
    significant = by_chance > SIGNIFICANT_SIGMAS and in_all > SIGNIFICANT_SIGMAS_IN_ALL
    if fit.effects.chosen[-1] in CONTRADICTIONS:
        # What contradicts the model also makes the halves disagree: by that scatter it would hide itself.
        significant |= by_chance > CONTRADICTING_SIGMAS
    values = zip(fit.effects.chosen, fit.effect_parameters, strict=True)
    return significant and all(EFFECTS[name].allows(value) for name, value in values)


def _remains_possible(fit: Fit, provable: Sequence[str]) -> bool:
    """Return whether the effect that was added last may be there although it is not proven."""
    name = fit.effects.chosen[-1]
    if name in CORRECTED and name in provable:
        return True
    return _sigmas_of_last(fit, fit.chance) > DOUBTED_SIGMAS


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


def _with_estimates(
    fit: Fit, trials: Sequence[_Trial], found: tuple[EffectEstimate, ...], refused: Sequence[str]
) -> Fit:
    """Return a fit with the estimates of effects, and with a covariance that has those that are left out.

    An effect that was suspected and refused may be there all the same, as large as it seems.
    """
    left_out = [trial for trial in trials if trial.name in CORRECTED or trial.name in refused]
    sizes = [np.hypot(trial.sigma, trial.value if trial.name in refused else 0.0) for trial in left_out]
    slopes = [_slope_of_left_out(fit, trial) for trial in left_out]
    widened = sum(size**2 * np.outer(slope, slope) for size, slope in zip(sizes, slopes, strict=True))
    fit = _without_typical_light(fit)
    estimates = (
        EffectEstimate(trial.name, trial.value, trial.sigma_in_all) for trial in left_out if trial.name in CORRECTED
    )
    return replace(fit, covariance=fit.covariance + widened, effect_estimates=(*found, *estimates))


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
