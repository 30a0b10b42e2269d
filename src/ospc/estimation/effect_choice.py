"""Selection of the effects that the observations show; those that cannot be determined widen the uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.estimation.effect_models import (
    COMMON,
    CONTRADICTIONS,
    CORRECTED,
    CURVES_OF_EXPOSURES,
    DRIFTING_LIGHT,
    EFFECTS,
    LOCAL_TONE_MAPPING,
    OF_STATIONARY_CAMERA,
    ONLY_IF_FOUND,
)
from ospc.estimation.effect_significance import is_significant, with_significant, without_insignificant
from ospc.estimation.effect_trials import (
    Trial,
    after_newton_step,
    change_until_end,
    estimate_effects,
    slope_of_left_out,
    suspected,
    trial_of,
)
from ospc.estimation.effects import Effects, different_log_exposures
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.fitted import Fitted
from ospc.estimation.frame_gains import PairEnds, gain_sigmas
from ospc.estimation.residual_effects import UNSTEADY_LIGHT, uneven_vignette, unsteadiness, unsteady_radiance
from ospc.estimation.vignette_choice import (
    fit_with_chosen_vignette,
    step_to_free_centre,
    with_possible_centre,
    with_uncertain_centre,
    with_vignette_chosen_again,
)
from ospc.estimation.wrong_pairs import registered_points, rightly_exposed_points
from ospc.numerics.robust import ERROR_OF_SCALE
from ospc.observations import ExposedObservations
from ospc.photometry.verdict import INEXACT_EXPOSURES, LATE_EXPOSURES, EffectEstimate
from ospc.settings.effects import (
    EXPOSURES_PER_CURVE,
    MIN_GROUPS,
    MOST_CURVES,
    MOST_RAMP_CORRELATION,
    MOST_SCATTERED_SHARE,
    SIGNIFICANT_SIGMAS,
)


def fit_with_chosen_effects(observations: ExposedObservations, plan: FitPlan) -> Fitted:
    """Fit response and vignette, and the effects that the observations clearly show.

    Pairs of frames that were registered wrongly or whose exposures are wrong are left out: the result has the
    observations that were used.

    Effects that any recording may have are fitted together, because they imitate each other; others are tried one by
    one, the clearest first. They are kept if they are significant given the scatter of the observations. If anything
    contradicts the model, nothing is corrected. Too few pairs of frames are not tested. If frames are still brighter
    or darker than predicted, by more than chance, each frame gets a latent gain. The possible size of every effect
    that is left out is added to the covariance. With a stationary camera, only errors of the exposures are tried.
    """
    plain = fit_with_chosen_vignette(observations, plan, Effects.none_of(observations))
    if not len(plan.widest):
        return replace(plain, fit=_of_stationary_camera(plain, plan))
    if not (in_place := registered_points(plain)).all():
        used = observations.of_points(in_place)
        plain = fit_with_chosen_vignette(used, plan, Effects.none_of(used))
    plain_trials, fitted, trials = _all_tried(plain, plan)
    # Before latent gains: those would take up some of what is wrong with the exposures.
    registered = None
    if not (right := rightly_exposed_points(fitted)).all():
        registered, used = plain.observations, plain.observations.of_points(right)
        plain = fit_with_chosen_vignette(used, plan, Effects.none_of(used))
        plain_trials, fitted, trials = _all_tried(plain, plan)
    fit = _of_moving_camera(plain, plain_trials, fitted, trials, plan)
    return replace(plain, fit=fit, registered=registered)


def _all_tried(plain: Fitted, plan: FitPlan) -> tuple[Sequence[Trial], Fitted, Sequence[Trial]]:
    """Return trials of all effects, the fit with the significant ones, and trials of the others."""
    plain_trials = estimate_effects(plain, tuple(EFFECTS))
    return plain_trials, *_with_effects(plain, plain_trials, plan, *_indistinguishable(plain.observations))


def _of_stationary_camera(plain: Fitted, plan: FitPlan) -> Fit:
    """Return the fit with the errors of the exposures that the observations show."""
    if plain.fit.groups < MIN_GROUPS:
        return plain.fit  # in a few brackets, an error of the exposures is part of the response
    fitted, trials = _with_effects(plain, estimate_effects(plain, OF_STATIONARY_CAMERA), plan)
    # A series takes seconds, often with the exposure only rising: a drift that it cannot show is not expected.
    expected = [trial for trial in trials if trial.name != DRIFTING_LIGHT]
    fitted = _with_model_errors(fitted)
    return _with_estimates(fitted, expected, _estimate_of_gains(fitted.fit, plain.observations))


def _of_moving_camera(
    plain: Fitted, plain_trials: Sequence[Trial], fitted: Fitted, trials: Sequence[Trial], plan: FitPlan
) -> Fit:
    """Return the fit with the effects and gains that the observations show, or with what contradicts the model."""
    # ``plain`` and ``fitted`` are the fits without effects and with those found, each with trials of the others.
    observations = plain.observations
    variances = _gain_variances(fitted)
    if not variances and _is_contradicted(fitted.fit):  # inexact exposures resemble it
        variances = _gain_variances(plain)
    # Gains come last, and not if exposures lag: they would hide the cause of the brightness changes.
    if variances and not _shows_lag(trials):
        plain, fitted = _with_gains(plain, fitted, variances, plan)
        plain_trials = estimate_effects(plain, tuple(EFFECTS))
        trials = plain_trials if fitted is plain else _estimate_left_out(fitted, tuple(EFFECTS))
    fitted = _with_model_errors(fitted)
    fit = fitted.fit
    if _is_contradicted(fit):
        return _with_estimates(plain, plain_trials, _estimates(fit)[-1:])
    if fit.groups < MIN_GROUPS:
        return _with_estimates(fitted, trials, ())
    if unsteady := _unsteadiness(fitted):
        # If the plain fit is steady, the effects are spurious.
        alone = not len(fit.effects) or _unsteadiness(plain)
        return _with_estimates(plain, plain_trials, unsteady if alone else ())
    found = uneven_vignette(fit.residuals(observations), fitted.weighted[0].sigma, observations)
    found = found or unsteady_radiance(fit.errors.radiance_sigma, fit.groups)
    return _with_estimates(fitted, trials, (*_estimate_of_gains(fit, observations), *found))


def _is_contradicted(fit: Fit) -> bool:
    return any(name in CONTRADICTIONS for name in fit.effects.chosen)


def _unsteadiness(fitted: Fitted) -> tuple[EffectEstimate, ...]:
    """Return differences between the frames of a pair, where the model is accurate enough to judge them."""
    fit, observations = fitted.fit, fitted.observations
    residual = np.where(_is_well_modelled(fit, observations), fit.residuals(observations), np.nan)
    return unsteadiness(residual, fitted.weighted[0].sigma, observations)


def _is_well_modelled(fit: Fit, observations: ExposedObservations) -> BoolArray:
    """Return where the basis resolves the response, and most of the light is not scattered, shape (n,)."""
    # The scattered light is known to a few per cent: an error that counts where it is most of the light.
    return fit.resolves(observations) & (fit.scattered_share(observations) < MOST_SCATTERED_SHARE)


def _with_effects(
    plain: Fitted, plain_trials: Sequence[Trial], plan: FitPlan, *left_out: str
) -> tuple[Fitted, Sequence[Trial]]:
    """Return a fit with the significant effects, except those ``left_out``, and trials of the others."""
    # The search ends at the first effect that contradicts the model.
    names = tuple(trial.name for trial in plain_trials)
    untried = tuple(name for name in names if name not in left_out)
    if plain.fit.groups < MIN_GROUPS or not suspected(plain_trials, untried):
        return plain, plain_trials
    observations = plain.observations
    if not (most_curves := _distinguishable_curves(observations)):
        untried = tuple(name for name in untried if name not in CURVES_OF_EXPOSURES)
    fitted = with_significant(plain, [name for name in COMMON if name in untried], plan)
    trials = plain_trials if fitted is plain else _estimate_left_out(fitted, names)
    while suspect := suspected(trials, untried):
        untried = tuple(name for name in untried if name != suspect.name)
        start = after_newton_step(fitted.fit, suspect)
        wider = plan.refit(observations, start)
        if not (is_significant(wider, -1) and _shown_if_well_modelled(wider, fitted, plan)):
            if suspect.name == LOCAL_TONE_MAPPING:  # one step sees half of it: the response has taken up the rest
                clearer = max(suspect, trial_of(wider), key=lambda trial: trial.sigmas)
                trials = [clearer if trial is suspect else trial for trial in trials]
            continue
        if sum(name in CURVES_OF_EXPOSURES for name in wider.effects.chosen) > most_curves:
            # Every exposure has its own error, which latent gains describe better.
            return _with_effects(plain, plain_trials, plan, *left_out, *CURVES_OF_EXPOSURES)
        if suspect.name in CONTRADICTIONS:
            return replace(fitted, fit=wider), trials
        fitted = with_vignette_chosen_again(replace(fitted, fit=wider), plan)
        trials = _estimate_left_out(fitted, names)
    # An effect that was found first may be explained by one that was found later.
    kept = without_insignificant(fitted, plain, plan)
    return kept, trials if kept is fitted else _estimate_left_out(kept, names)


def _shown_if_well_modelled(wider: Fit, fitted: Fitted, plan: FitPlan) -> bool:
    """Return whether the points that are well modelled without the last effect show it, if it is a contradiction."""
    if wider.effects.chosen[-1] not in CONTRADICTIONS:
        return True
    observations = fitted.observations
    known = observations.combined(np.minimum, _is_well_modelled(fitted.fit, observations).astype(np.float64)) > 0
    if known.all():
        return True
    left = observations.of_points(known)
    return len(np.unique(left.group)) < MIN_GROUPS or is_significant(plan.refit(left, wider), -1)


def _indistinguishable(observations: ExposedObservations) -> tuple[str, ...]:
    """Return the effects that are almost a power of the exposures: a drift while the exposure rises or falls."""
    correlation = np.corrcoef(observations.log_exposure, observations.frame)[0, 1]
    return (DRIFTING_LIGHT,) if abs(correlation) > MOST_RAMP_CORRELATION else ()


def _distinguishable_curves(observations: ExposedObservations) -> int:
    """Return how many curves of the exposures can be told from errors of individual exposures."""
    # Two parameters are not errors: a factor on all exposures, and a power of them.
    different = len(different_log_exposures(observations.log_exposure)) - 2
    return min(max(different // EXPOSURES_PER_CURVE, 0), MOST_CURVES)


def _with_gains(plain: Fitted, fitted: Fitted, variances: tuple[float, ...], plan: FitPlan) -> tuple[Fitted, Fitted]:
    """Return two fits with latent gains: without effects, and with those that are still significant."""

    def allowing(before: Fitted) -> Fitted:
        return replace(before, fit=replace(before.fit, errors=replace(before.fit.errors, gain_variances=variances)))

    def refitted(start: Fitted) -> Fitted:
        return replace(start, fit=plan.refit(start.observations, start.fit))

    start = allowing(plain)
    if len(fitted.fit.effects):
        fitted = without_insignificant(refitted(allowing(fitted)), start, plan)
    plain = refitted(start)
    return plain, fitted if len(fitted.fit.effects) else plain


def _shows_lag(left_out: Sequence[Trial]) -> bool:
    """Return whether the exposures clearly have an uncorrected lag."""
    late = (trial for trial in left_out if trial.name == LATE_EXPOSURES)
    return any(abs(trial.value) > SIGNIFICANT_SIGMAS * trial.total_sigma for trial in late)


def _estimate_left_out(fitted: Fitted, names: Sequence[str]) -> Sequence[Trial]:
    """Return trials of those effects that a fit leaves out."""
    return estimate_effects(fitted, [name for name in names if name not in fitted.fit.effects.chosen])


def _gain_variances(fitted: Fitted) -> tuple[float, ...]:
    """Return the variances of latent gains beyond chance; empty if there are none or too few pairs."""
    enough = fitted.observations.in_pairs and fitted.fit.groups >= MIN_GROUPS
    return fitted.significant_gain_variances if enough else ()


def _estimate_of_gains(fit: Fit, observations: ExposedObservations) -> tuple[EffectEstimate, ...]:
    """Return the size of the fit's latent gains; empty if there are none."""
    of_light, of_exposures = gain_sigmas(fit.errors.gain_variances, PairEnds.of(observations))
    larger = max(of_light, of_exposures)
    name = UNSTEADY_LIGHT if larger == of_light else INEXACT_EXPOSURES
    found = EffectEstimate(name, larger, larger * ERROR_OF_SCALE / math.sqrt(fit.groups), corrected=True)
    return (found,) if larger else ()


def _estimates(fit: Fit) -> tuple[EffectEstimate, ...]:
    """Return the estimates of the effects that a fit has."""
    sigma = np.sqrt(np.diag(fit.covariance))[fit.vignette_part.stop :]
    return tuple(
        EffectEstimate(name, float(value), float(deviation), name in CORRECTED, name in CONTRADICTIONS)
        for name, value, deviation in zip(fit.effects.chosen, fit.effect_parameters, sigma, strict=True)
    )


def _with_model_errors(fitted: Fitted) -> Fitted:
    """Return a fit whose covariance includes how much the real effects differ from their models."""
    fit = fitted.fit
    if not len(fit.effects):
        return fitted
    covariance = fit.covariance
    for number, name in enumerate(fit.effects.chosen, fit.vignette_part.stop):
        error = EFFECTS[name].model_error * fit.parameters[number]
        change = error * fit.chance[:, number] / fit.chance[number, number]
        covariance = covariance + np.outer(change, change)
    return replace(fitted, fit=replace(fit, covariance=covariance))


def _with_estimates(fitted: Fitted, trials: Sequence[Trial], found: tuple[EffectEstimate, ...]) -> Fit:
    """Return a fit whose covariance includes what was left out, with estimates of all effects besides those found."""
    missing = [
        trial.size_if_left_out * change
        for trial in trials
        for change in (slope_of_left_out(fitted.fit, trial), change_until_end(fitted.fit, trial))
    ]
    fit = _without_absorbed_light(fitted.fit)
    fit = replace(fit, covariance=fit.covariance + sum(np.outer(one, one) for one in missing))
    left_out = (
        EffectEstimate(trial.name, trial.value, trial.total_sigma)
        for trial in trials
        if trial.name in CORRECTED and trial.name not in ONLY_IF_FOUND
    )
    fit = replace(fit, effect_estimates=(*found, *_estimates(fit), *left_out))
    if not fit.vignette_basis.radial:
        return fit
    if fit.vignette_basis.free_centre:
        return with_uncertain_centre(fit)
    return with_possible_centre(fit, *step_to_free_centre(fitted))


def _without_absorbed_light(fit: Fit) -> Fit:
    """Return a fit whose response does not contain the typical amount of additional light."""

    def changed(parameters: FloatArray) -> FloatArray:
        return fit.effects.without_absorbed_light(fit.response_basis, parameters)[1]

    effects, parameters = fit.effects.without_absorbed_light(fit.response_basis, fit.parameters)
    if not len(effects):
        return replace(fit, effects=effects)
    # Forward differences; those of scipy.optimize take a quarter of a second to import.
    step = float(np.sqrt(np.finfo(np.float64).eps))
    changes = [changed(fit.parameters + step * unit) - parameters for unit in np.eye(len(fit.parameters))]
    slope = np.stack(changes, axis=-1) / step
    covariance, chance = (slope @ matrix @ slope.T for matrix in (fit.covariance, fit.chance))
    return replace(fit, effects=effects, parameters=parameters, covariance=covariance, chance=chance)
