"""Selection of the vignette model by an information criterion: radial, decentred, or with non-radial terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.fitted import Fitted
from ospc.estimation.model import Model
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import ExposedObservations
from ospc.settings.vignette import (
    ASYMMETRY_SIGMA,
    CENTRE_ERROR_FACTOR,
    FIRST_FIT_POINTS,
    MAX_ASYMMETRY,
    MIN_CRITERION_GROUPS,
    POSSIBLE_CENTRE_SIGMA,
    PROMISING_SHARE,
    VIGNETTE_REACH,
)


def fit_with_chosen_vignette(
    observations: ExposedObservations, plan: FitPlan, effects: Effects | None = None, start: Fit | None = None
) -> Fitted:
    """Fit response and vignette, with no more vignette parameters than the data support.

    Starting from the purely radial model, first a free centre is tried, and then the non-radial terms, which include
    the centre if it was rejected. Each step has to meet the criterion of Schwarz (1978): the joint Wald statistic of
    the added parameters, with a covariance that includes correlated errors, must exceed their number times the
    logarithm of the number of groups. If the centre is so far off that the corner farthest from it is beyond the last
    knot, the knots are placed to include it, as far as those of the plan's widest model. ``effects`` are fitted with
    the vignette; None for none. ``start`` is an earlier fit with the same response basis, if there is one.
    """
    effects = Effects() if effects is None else effects
    simplest, *_ = _models(plan)
    # A subset of the points already gives most of the solution; only the last rounds need all of them.
    step = len(observations.starts) // FIRST_FIT_POINTS
    if start is None and step > 1:
        start = plan.fit(observations.of_points(slice(None, None, step)), simplest, effects)
    return _extended(Fitted(plan.fit(observations, simplest, effects, start), observations, plan.noise), plan)


def with_vignette_chosen_again(fitted: Fitted, plan: FitPlan) -> Fitted:
    """Return a fit with the vignette that its observations support, now that it has other effects.

    The effects may have imitated a part of the vignette, or hidden one: parameters that have lost their support go,
    and others may have gained it.
    """
    fit = fitted.fit
    fewer = (len(basis) for basis in _models(plan) if len(basis) < len(fit.vignette_basis))
    if all(supported(fit, len(fit.vignette_basis) - terms) for terms in fewer):
        return _extended(fitted, plan)
    return fit_with_chosen_vignette(fitted.observations, plan, fit.effects, fit)


def _models(plan: FitPlan) -> tuple[VignetteBasis, ...]:
    """Return the models of the vignette, the simplest first."""
    widest = replace(plan.widest, reach=VIGNETTE_REACH)
    simplest = replace(widest, free_centre=False, non_radial=False)
    models = dict.fromkeys((simplest, replace(simplest, free_centre=True), widest))
    return tuple(basis for basis in models if len(basis) <= len(widest))


def _extended(fitted: Fitted, plan: FitPlan) -> Fitted:
    """Return a fit with all further parameters of the vignette that the observations support."""
    observations, effects, present = fitted.observations, fitted.fit.effects, fitted.fit.vignette_basis
    richer = [replace(basis, reach=present.reach) for basis in _models(plan) if len(basis) > len(present)]
    while richer and (promising := _first_promising(fitted, richer)):
        richer = richer[richer.index(promising) + 1 :]
        wider = plan.fit(observations, promising, effects, fitted.fit)
        if supported(wider, len(promising) - len(fitted.fit.vignette_basis)):
            reach = min(promising.reach_of_far_corner(wider.vignette_parameters), plan.widest.reach)
            if reach != promising.reach:
                wider = plan.fit(observations, replace(promising, reach=reach), effects, wider)
                richer = [replace(basis, reach=reach) for basis in richer]
            fitted = replace(fitted, fit=wider)
    return fitted


def _first_promising(fitted: Fitted, richer: Sequence[VignetteBasis]) -> VignetteBasis | None:
    """Return the first of several vignette models, the largest last, that one Newton step nearly supports."""
    fit, widest = fitted.fit, richer[-1]
    model = Model(fit.response_basis, widest, fit.effects)
    about = fit.parameters_in(model)
    # The parameters of a model come first among those of a larger one.
    first = fit.vignette_part.start
    choices = [np.delete(np.arange(len(about)), np.s_[first + len(basis) : first + len(widest)]) for basis in richer]
    steps = fitted.newton_steps(model, about, choices)
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


def with_possible_centre(fit: Fit, parameters: FloatArray, chance: FloatArray) -> Fit:
    """Return a fit whose covariance includes how far the vignette may be from the centre of the image.

    If all objects cross the image in one direction, as when a camera only pans, the observations hardly show where
    the vignette's centre is in the other. The fit keeps it in the middle, but it may be elsewhere. If the
    observations determine it well, the fit is returned unchanged.

    Parameters
    ----------
    fit
        A fit with a centred vignette.
    parameters, chance
        Parameters of the same fit with a free centre, shape (p + 2,), and their covariance due to chance.
    """
    basis = replace(fit.vignette_basis, free_centre=True)
    centre = replace(fit, vignette_basis=basis).centre_part
    vignette = np.insert(fit.vignette_parameters, basis.centre_part.start, np.zeros(2))
    if _shows_centre(basis, vignette, chance[centre, centre]):
        return fit
    possible = np.outer(parameters[centre], parameters[centre]) + CENTRE_ERROR_FACTOR**2 * chance[centre, centre]
    possible = np.asarray(
        np.linalg.inv(np.linalg.inv(possible) + np.eye(2) / POSSIBLE_CENTRE_SIGMA**2), dtype=np.float64
    )
    added = _due_to_centre(possible, chance, centre)
    others = np.delete(np.arange(len(parameters)), centre)

    def wider(covariance: FloatArray) -> FloatArray:
        whole = added.copy()
        whole[np.ix_(others, others)] += covariance
        return whole

    return replace(
        fit,
        vignette_basis=basis,
        parameters=np.insert(fit.parameters, centre.start, np.zeros(2)),
        covariance=wider(fit.covariance),
        chance=wider(fit.chance),
    )


def with_uncertain_centre(fit: Fit) -> Fit:
    """Return a fit with a free centre, with a larger covariance if the observations hardly show the centre."""
    centre = fit.centre_part
    chance = fit.chance[centre, centre]
    if _shows_centre(fit.vignette_basis, fit.vignette_parameters, chance):
        return fit
    added = _due_to_centre((CENTRE_ERROR_FACTOR**2 - 1) * chance, fit.chance, centre)
    return replace(fit, covariance=fit.covariance + added)


def _due_to_centre(covariance: FloatArray, chance: FloatArray, centre: slice) -> FloatArray:
    """Return the covariance of all parameters due to the centre's, (2, 2), given theirs due to chance, (p, p)."""
    slope = chance[:, centre] @ np.linalg.inv(chance[centre, centre])
    return np.asarray(slope @ covariance @ slope.T, dtype=np.float64)


def _shows_centre(basis: VignetteBasis, parameters: FloatArray, chance: FloatArray) -> bool:
    """Return whether observations show a free centre, given its covariance due to chance, shape (2, 2)."""
    deviation = float(np.sqrt(np.linalg.eigvalsh(chance)[-1]))
    return deviation < MAX_ASYMMETRY * _shift_of_centre(basis, parameters)


def step_to_free_centre(fitted: Fitted) -> tuple[FloatArray, FloatArray]:
    """Return the parameters of a fit after one Newton step with a free centre, and their covariance due to chance."""
    fit = fitted.fit
    model = Model(fit.response_basis, replace(fit.vignette_basis, free_centre=True), fit.effects)
    about = fit.parameters_in(model)
    return next(fitted.newton_steps(model, about, [np.arange(len(about))]))


def _registration_sigma(fit: Fit) -> FloatArray:
    """Return the standard deviation of each vignette parameter from errors that all pairs share, (len,)."""
    basis, parameters = fit.vignette_basis, fit.vignette_parameters
    sigma = np.full(len(basis), ASYMMETRY_SIGMA)
    if basis.free_centre:
        sigma[basis.centre_part] *= _shift_of_centre(basis, parameters)
    return sigma


def _shift_of_centre(basis: VignetteBasis, parameters: FloatArray) -> float:
    """Return the shift of a free centre that makes ln V asymmetric by R, in half diagonals."""
    # It is inversely proportional to the slope of ln V: a flat vignette has no centre.
    radii = np.linspace(0, basis.usable_radius)
    along = basis.centre(parameters) + np.stack([radii, np.zeros_like(radii)], axis=1)
    slope = basis.jacobian(parameters, along)[:, basis.radial]
    return float(np.linalg.norm(radii) / max(float(np.linalg.norm(slope)), 1e-9))
