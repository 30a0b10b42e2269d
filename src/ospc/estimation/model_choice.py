"""Selection of the vignette model and of the effects that the observations show.

A decentred or non-radial vignette is selected by an information criterion. Effects that cannot be determined widen
the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.effect_models import CONTRADICTIONS, CORRECTED, EFFECTS, GAIN_STEPS, ONLY_IF_FOUND
from ospc.estimation.effect_trials import Trial, after_newton_step, estimate_effects, slope_of_left_out, trial_of
from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.estimation.frame_gains import gain_sigma
from ospc.estimation.maximum_likelihood import Fitted, MaximumLikelihoodEstimator
from ospc.estimation.residual_effects import UNSTEADY_LIGHT, uneven_vignette, unsteadiness, unsteady_radiance
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.verdict import LATE_EXPOSURES, EffectEstimate
from ospc.robust import ERROR_OF_SCALE
from ospc.settings.effects import (
    CONTRADICTING_SIGMAS,
    MIN_GROUPS,
    MOST_GAIN_STEPS,
    PREFERRED_SHARE,
    SIGNIFICANT_SIGMAS,
    SIGNIFICANT_SIGMAS_IN_ALL,
    SUSPECTED_LIGHT_SIGMAS,
    SUSPECTED_SIGMAS,
)
from ospc.settings.vignette import (
    ASYMMETRY_SIGMA,
    FIRST_FIT_POINTS,
    MIN_CRITERION_GROUPS,
    PROMISING_SHARE,
)


def fit_with_chosen_vignette(  # noqa: PLR0917 (what is fitted, to what)
    observations: ExposedObservations,
    response: ResponseBasis,
    widest: VignetteBasis,
    noise: NoiseModel | None,
    rounds: int,
    effects: Effects | None = None,
) -> Fitted:
    """Fit response and vignette, with no more vignette parameters than the data support.

    Starting from the purely radial model, first a free centre is tried, and then the non-radial terms, which include
    the centre if it was rejected. Each step has to meet the criterion of Schwarz (1978): the joint Wald statistic of
    the added parameters, with a covariance that includes correlated errors, must exceed their number times the
    logarithm of the number of groups.

    Parameters
    ----------
    widest
        The vignette model with the most parameters.
    noise
        Noise of single pixels; None if the observations are single pixels.
    rounds
        Maximum number of rounds of each fit after the first, convex one.
    effects
        Effects that are fitted with it; None for none.
    """
    effects = Effects() if effects is None else effects
    simplest = replace(widest, free_centre=False, non_radial=False)
    estimator = MaximumLikelihoodEstimator(response, simplest, noise, rounds, effects)
    # A subset of the points already gives most of the solution; only the last rounds need all of them.
    step = len(observations.starts) // FIRST_FIT_POINTS
    start = estimator.fit(observations.of_points(slice(None, None, step))) if step > 1 else None
    fitted = Fitted(estimator.fit(observations, start), observations, noise)
    richer = [
        basis for basis in (replace(simplest, free_centre=True), widest) if len(simplest) < len(basis) <= len(widest)
    ]
    while richer and (promising := _first_promising(fitted, richer)):
        richer = richer[richer.index(promising) + 1 :]
        estimator = MaximumLikelihoodEstimator(response, promising, noise, rounds, effects)
        wider = estimator.fit(observations, fitted.fit)
        if supported(wider, len(promising) - len(fitted.fit.vignette_basis)):
            fitted = replace(fitted, fit=wider)
    return fitted


def _first_promising(fitted: Fitted, richer: Sequence[VignetteBasis]) -> VignetteBasis | None:
    """Return the first of several vignette models, the largest last, that one Newton step nearly supports."""
    fit, widest = fitted.fit, richer[-1]
    estimator = MaximumLikelihoodEstimator(fit.response_basis, widest, fitted.noise, rounds=0, effects=fit.effects)
    about = estimator.parameters_of(fit)
    # The parameters of a model come first among those of a larger one.
    first = fit.vignette_part.start
    choices = [np.delete(np.arange(len(about)), np.s_[first + len(basis) : first + len(widest)]) for basis in richer]
    steps = estimator.newton_steps(fitted, about, choices)
    for basis, (found, chance) in zip(richer, steps, strict=True):
        after = replace(fit, vignette_basis=basis, parameters=found, chance=chance)
        if supported(after, len(basis) - len(fit.vignette_basis), PROMISING_SHARE):
            return basis
    return None


def supported(fit: Fit, last: int, share: float = 1.0) -> bool:
    """Return whether the last ``last`` parameters of the vignette meet the criterion, or a share of it."""
    end = fit.vignette_part.stop
    part = slice(end - last, end)
    value = fit.parameters[part]
    covariance = fit.chance[part, part] + np.diag(_registration_sigma(fit)[-last:] ** 2)
    statistic = float(value @ np.linalg.solve(covariance, value))
    return bool(statistic > share * last * np.log(max(fit.groups, MIN_CRITERION_GROUPS)))


def _registration_sigma(fit: Fit) -> FloatArray:
    """Return the standard deviation of each vignette parameter from errors that all pairs share, (len,)."""
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
    """Fit response and vignette, and the effects that the observations clearly show.

    Effects are tried one by one, the clearest first, and kept if they are significant given the scatter of the
    observations. If anything contradicts the model, nothing is corrected, because effects imitate each other. Too few
    pairs of frames are not tested. If frames are still brighter or darker than predicted, by more than chance, each
    frame gets a latent gain. The possible size of every effect that is left out is added to the covariance. A
    stationary camera is fitted without effects. The parameters are as in :func:`fit_with_chosen_vignette`.
    """
    plain = fit_with_chosen_vignette(observations, response, widest, noise, rounds, Effects.none_of(observations))
    if not len(widest):
        return plain.fit  # in the few frames of a stationary camera, time and exposure are confounded
    plain_trials = estimate_effects(plain, tuple(EFFECTS))
    fitted, trials = _with_effects(plain, plain_trials, widest, rounds)
    # Gains come last, and not if exposures lag: they would hide the cause of the brightness changes.
    if not _shows_lag(trials) and (variances := _gain_variances(fitted)):
        found_none = fitted is plain
        plain = _with_gains(plain, variances, rounds)
        plain_trials = estimate_effects(plain, tuple(EFFECTS))
        fitted = plain if found_none else _with_gains(fitted, variances, rounds)
        trials = plain_trials if found_none else estimate_effects(fitted, _left_out(fitted.fit))
    fit = _with_model_errors(fitted.fit)
    if any(name in CONTRADICTIONS for name in fit.effects.chosen):
        return _with_estimates(plain.fit, plain_trials, _estimates(fit, observations)[-1:])
    if fit.groups < MIN_GROUPS:
        return _with_estimates(fit, trials, ())
    residual = fit.residuals(observations)
    if unsteady := unsteadiness(residual, observations):
        # If the plain fit is steady, the effects are spurious.
        alone = fitted is plain or unsteadiness(plain.fit.residuals(observations), observations)
        return _with_estimates(plain.fit, plain_trials, unsteady if alone else ())
    uneven = uneven_vignette(residual, observations) or unsteady_radiance(fit.errors.radiance_sigma, fit.groups)
    return _with_estimates(fit, trials, (*_estimates(fit, observations), *uneven))


def _with_effects(
    plain: Fitted, plain_trials: Sequence[Trial], widest: VignetteBasis, rounds: int, *left_out: str
) -> tuple[Fitted, Sequence[Trial]]:
    """Return a fit with the significant effects, except those ``left_out``, and trials of the others.

    The search ends at the first effect that contradicts the model.
    """
    fitted, trials = plain, plain_trials
    observations, noise = fitted.observations, fitted.noise
    tested = fitted.fit.groups >= MIN_GROUPS
    untried = tuple(name for name in EFFECTS if tested and name not in left_out)
    while suspect := _suspected(trials, untried):
        untried = tuple(name for name in untried if name != suspect.name)
        chosen = fitted.fit.effects.chosen
        if suspect.name in GAIN_STEPS and sum(name in GAIN_STEPS for name in chosen) == MOST_GAIN_STEPS:
            # Every exposure has its own error, which latent gains describe better.
            return _with_effects(plain, plain_trials, widest, rounds, *GAIN_STEPS)
        start = after_newton_step(fitted.fit, suspect)
        wider = _estimator(start, noise, rounds).fit(observations, start)
        if not _significant(wider, -1):
            if suspect.name == "local tone mapping":  # one step sees half of it: the response has taken up the rest
                clearer = max(suspect, trial_of(wider), key=lambda trial: trial.sigmas)
                trials = [clearer if trial is suspect else trial for trial in trials]
            continue
        if suspect.name in CONTRADICTIONS:
            return replace(fitted, fit=wider), trials
        response = start.response_basis
        fitted = fit_with_chosen_vignette(observations, response, widest, noise, rounds, start.effects)
        trials = estimate_effects(fitted, _left_out(fitted.fit))
    return fitted, trials


def _with_gains(fitted: Fitted, variances: tuple[float, ...], rounds: int) -> Fitted:
    """Return a fit with latent gains, and with those effects that are still significant."""
    start = replace(fitted.fit, errors=replace(fitted.fit.errors, gain_variances=variances))
    while True:
        fit = _estimator(start, fitted.noise, rounds).fit(fitted.observations, start)
        doubtful = [i for i in range(len(fit.effects)) if not _significant(fit, i)]
        if not doubtful:
            return replace(fitted, fit=fit)
        weakest = min(doubtful, key=lambda i: _sigmas_of(fit, i, fit.chance))
        kept = tuple(name for i, name in enumerate(fit.effects.chosen) if i != weakest)
        parameters = np.delete(fit.parameters, fit.vignette_part.stop + weakest)
        start = replace(fit, effects=replace(fit.effects, chosen=kept), parameters=parameters)


def _shows_lag(left_out: Sequence[Trial]) -> bool:
    """Return whether the exposures clearly have an uncorrected lag."""
    late = (trial for trial in left_out if trial.name == LATE_EXPOSURES)
    return any(abs(trial.value) > SIGNIFICANT_SIGMAS * trial.total_sigma for trial in late)


def _estimator(fit: Fit, noise: NoiseModel | None, rounds: int) -> MaximumLikelihoodEstimator:
    return MaximumLikelihoodEstimator(fit.response_basis, fit.vignette_basis, noise, rounds, fit.effects)


def _left_out(fit: Fit) -> tuple[str, ...]:
    return tuple(name for name in EFFECTS if name not in fit.effects.chosen)


def _gain_variances(fitted: Fitted) -> tuple[float, ...]:
    """Return the variances of latent gains beyond chance; empty if there are none or too few pairs."""
    if not fitted.observations.in_pairs or fitted.fit.groups < MIN_GROUPS:
        return ()
    return _estimator(fitted.fit, fitted.noise, 0).significant_gain_variances(fitted)


def _suspected(trials: Sequence[Trial], untried: Sequence[str]) -> Trial | None:
    """Return the clearest untried effect; effects of a camera are preferred if they are nearly as clear."""
    likely = [trial for trial in trials if trial.name in untried]
    threshold = max(SUSPECTED_SIGMAS, PREFERRED_SHARE * max((trial.sigmas for trial in likely), default=0.0))
    clear = [trial for trial in likely if trial.sigmas > threshold]
    if not clear:
        light = (trial for trial in likely if EFFECTS[trial.name].adds == "light")
        clear = [trial for trial in light if trial.sigmas_by_chance > SUSPECTED_LIGHT_SIGMAS]
    return max(clear, key=lambda trial: (trial.name in CORRECTED, trial.sigmas), default=None)


def _significant(fit: Fit, number: int) -> bool:
    """Return whether an effect is significant and all effects are plausible."""
    by_chance, in_all = (_sigmas_of(fit, number, covariance) for covariance in (fit.chance, fit.covariance))
    significant = by_chance > SIGNIFICANT_SIGMAS and in_all > SIGNIFICANT_SIGMAS_IN_ALL
    if fit.effects.chosen[number] in CONTRADICTIONS:
        # A contradiction also makes the halves disagree, and that scatter would hide it.
        significant |= by_chance > CONTRADICTING_SIGMAS
    values = zip(fit.effects.chosen, fit.effect_parameters, strict=True)
    return significant and all(EFFECTS[name].allows(value) for name, value in values)


def _sigmas_of(fit: Fit, number: int, covariance: FloatArray) -> float:
    """Return the distance of an effect from zero, in standard deviations given a covariance."""
    systematic, variance = EFFECTS[fit.effects.chosen[number]].systematic, np.diag(covariance)[-len(fit.effects) :]
    return float(abs(fit.effect_parameters[number]) / np.hypot(np.sqrt(variance[number]), systematic))


def _estimates(fit: Fit, observations: ExposedObservations) -> tuple[EffectEstimate, ...]:
    """Return the estimates of the latent gains, if any, and of the effects."""
    sigma = np.sqrt(np.diag(fit.covariance))[fit.vignette_part.stop :]
    gain = gain_sigma(fit.errors.gain_variances, observations.frames_of_groups)
    of_gains = EffectEstimate(UNSTEADY_LIGHT, gain, gain * ERROR_OF_SCALE / math.sqrt(fit.groups), corrected=True)
    of_effects = (
        EffectEstimate(name, float(value), float(deviation), name in CORRECTED, name in CONTRADICTIONS)
        for name, value, deviation in zip(fit.effects.chosen, fit.effect_parameters, sigma, strict=True)
    )
    return (of_gains, *of_effects) if gain else tuple(of_effects)


def _with_model_errors(fit: Fit) -> Fit:
    """Return a fit whose covariance includes how much the real effects differ from their models."""
    covariance = fit.covariance
    for number, name in enumerate(fit.effects.chosen, fit.vignette_part.stop):
        error = EFFECTS[name].model_error * fit.parameters[number]
        change = error * fit.chance[:, number] / fit.chance[number, number]
        covariance = covariance + np.outer(change, change)
    return replace(fit, covariance=covariance)


def _with_estimates(fit: Fit, trials: Sequence[Trial], found: tuple[EffectEstimate, ...]) -> Fit:
    """Return a fit with the estimates of effects, and with a covariance that includes those left out."""
    missing = [trial.size_if_left_out * slope_of_left_out(fit, trial) for trial in trials]
    fit = _without_absorbed_light(fit)
    covariance = fit.covariance + sum(np.outer(one, one) for one in missing)
    estimates = (
        EffectEstimate(trial.name, trial.value, trial.total_sigma)
        for trial in trials
        if trial.name in CORRECTED and trial.name not in ONLY_IF_FOUND
    )
    return replace(fit, covariance=covariance, effect_estimates=(*found, *estimates))


def _without_absorbed_light(fit: Fit) -> Fit:
    """Return a fit whose response does not contain the typical amount of additional light."""

    def changed(parameters: FloatArray) -> FloatArray:
        return fit.effects.without_absorbed_light(fit.response_basis, parameters)[1]

    effects, parameters = fit.effects.without_absorbed_light(fit.response_basis, fit.parameters)
    if not len(effects):
        return replace(fit, effects=effects)
    from scipy.optimize import approx_fprime  # slow to import and rarely needed

    slope = approx_fprime(fit.parameters, changed)
    covariance, chance = (slope @ matrix @ slope.T for matrix in (fit.covariance, fit.chance))
    return replace(fit, effects=effects, parameters=parameters, covariance=covariance, chance=chance)
