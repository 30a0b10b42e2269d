"""Joint fit of response and vignette to all observations: robust maximum likelihood with latent irradiance.

The first round is a convex problem, a non-negative least squares fit. Each further round repeats it with the model
linearised at the grey levels predicted by the previous round, with robust weights, an error model fitted to the
residuals, and a new choice of the strength of the prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.latent import LatentModel
from ospc.estimation.model import LinearSystem, Model
from ospc.estimation.normal_equations import NormalEquations, at_least
from ospc.estimation.prior import START, Prior, PriorHyperparameters
from ospc.estimation.robust_weights import redescending_weights
from ospc.estimation.shared_errors import SharedErrors
from ospc.estimation.vignette_basis import measured_radius
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.settings.error_model import CONVEX_ROUNDS
from ospc.settings.fit import MIN_BLOCKS, SETTLED_SIGMAS, TEXTURE_SHARE_INFORMATION
from ospc.settings.response import FIRST_KNEE_EVIDENCE, KNEE_EVIDENCE
from ospc.system.library_threads import one_blas_thread


@dataclass(frozen=True)
class _Estimate:
    """What each round of a fit improves.

    These are the parameters of the model, the error model, the corrected share of the texture, the hyperparameters of
    the prior, the robust weights, the index of each predicted grey level, and the sandwich factor of the weights.
    """

    parameters: FloatArray
    errors: ErrorModel
    texture_share: float
    hyperparameters: PriorHyperparameters
    weight: FloatArray
    index: IntArray
    sandwich_factor: float = 1.0


@dataclass(frozen=True)
class _Solution:
    """Solution of a round's linear system: the new estimate, and what its covariance is computed from.

    ``before`` and ``precision`` are the precisions of the prior before the round and of the solution;
    ``squared_sigmas`` is the squared distance that the parameters moved, in standard deviations.
    """

    estimate: _Estimate
    equations: NormalEquations
    prior: Prior
    before: FloatArray
    precision: FloatArray
    squared_sigmas: float


def fit_model(
    model: Model, noise: NoiseModel | None, observations: ExposedObservations, rounds: int, start: Fit | None = None
) -> Fit:
    """Fit a model to observations, starting from an earlier fit with the same response basis if there is one.

    After the first round in which outliers lose weight, there are at most ``rounds`` more; the fit ends earlier once
    no parameter moves by more than about a tenth of a standard deviation. It uses one core: threads slow down its
    many small matrix products. By the noise of single pixels, clipping biases their mean near the ends; it is None if
    the observations are single pixels.
    """
    with one_blas_thread():
        return _fit(model, noise, observations, rounds, start)


def _fit(
    model: Model, noise: NoiseModel | None, observations: ExposedObservations, rounds: int, start: Fit | None
) -> Fit:
    present = _beginning(model, observations, start)
    convex_rounds = CONVEX_ROUNDS if start is None else 0
    for number in range(convex_rounds + rounds + 1):
        trusted, convex = number > 0 or start is not None, number < convex_rounds
        coefficients, _, _ = model.split(present.parameters)
        predict = LatentModel(
            model.response_basis, coefficients, present.errors, noise, present.texture_share, trusted
        )
        system, present = _linearised(model, observations, present, predict, convex=convex)
        knee_evidence = FIRST_KNEE_EVIDENCE if convex else KNEE_EVIDENCE
        solution = _solved(system, present, knee_evidence, trusted=trusted)
        present = solution.estimate
        settled = solution.squared_sigmas < SETTLED_SIGMAS**2 * len(present.parameters)
        if number == convex_rounds + rounds or (settled and number > convex_rounds + 1):
            shared = system.shared_errors(present.parameters, solution.before, present.sandwich_factor)
            break
        del system  # it takes as much memory as the observations
    return _as_fit(model, observations, predict, solution, shared)


def _beginning(model: Model, observations: ExposedObservations, start: Fit | None) -> _Estimate:
    index, weight = model.response_basis.index_of(observations.grey), np.ones(len(observations))
    if start is None:
        return _Estimate(model.typical, ErrorModel(), 0.0, START, weight, index)
    about = start.parameters_in(model)
    return _Estimate(about, start.errors, start.texture_share, start.hyperparameters, weight, index)


def _linearised(
    model: Model, observations: ExposedObservations, present: _Estimate, predict: LatentModel, *, convex: bool
) -> tuple[LinearSystem, _Estimate]:
    """Linearise the observations about an estimate; return the system, and the estimate with new weights."""
    parameters = present.parameters
    log_gain = model.log_gain(parameters, observations, present.index)
    latent = predict(observations, log_gain, present.weight)
    errors, weight, sandwich_factor = present.errors, present.weight, present.sandwich_factor
    if predict.trusted:
        unclipped = predict.unclipped(observations, latent)
        weight = unclipped.astype(np.float64)
        if not convex:
            weight, sandwich_factor = redescending_weights(latent.studentised, unclipped)
            sandwich_factor /= observations.error_factor
        errors = errors.refitted(
            latent.residual**2 / latent.one_minus_leverage / latent.log_response_slope**2,
            latent.grey,
            1 / latent.log_response_slope,
            latent.irradiance,
            observations.gradient,
        )
    system = LinearSystem(model, parameters, observations, latent, weight, errors.gain_variances)
    weighted = replace(present, errors=errors, weight=weight, sandwich_factor=sandwich_factor, index=latent.index)
    return system, weighted


def _solved(system: LinearSystem, present: _Estimate, knee_evidence: float, *, trusted: bool) -> _Solution:
    """Solve the system with the prior that the data choose; unless ``trusted``, keep the share of texture."""
    model, texture_share = system.model, present.texture_share
    prior = model.prior(system.about)
    before = prior.precision(present.hyperparameters)
    with_share = system.equations(before, present.sandwich_factor)
    equations = with_share.part(np.arange(len(system.about))).scaled(before, present.sandwich_factor)
    if trusted:
        in_units = before / equations.information_scale
        change = with_share.last_fitted(in_units, prior.mean, TEXTURE_SHARE_INFORMATION, 1 - texture_share)
        texture_share = float(np.clip(texture_share + change, 0.0, 1.0))
    hyperparameters = equations.maximize_evidence(prior, present.hyperparameters, knee_evidence)
    parameters = model.limited(equations.solve(prior, hyperparameters, model.floor), system.about)
    moved, errors = parameters - system.about, present.errors
    if system.has_gains:
        errors = replace(errors, gain_variances=system.gains(parameters).refitted_variances)
    found = replace(
        present, parameters=parameters, errors=errors, texture_share=texture_share, hyperparameters=hyperparameters
    )
    precision = equations.posterior_precision(prior, hyperparameters)
    return _Solution(found, equations, prior, before, precision, float(moved @ precision @ moved))


def _as_fit(
    model: Model, observations: ExposedObservations, predict: LatentModel, solution: _Solution, shared: SharedErrors
) -> Fit:
    """Return the fit with its covariance, given the errors that all pairs share."""
    found = solution.estimate
    covariance = solution.equations.covariance(solution.prior, found.hyperparameters, shared)
    groups = len(np.unique(observations.group))
    # Fitted gain variances follow the means of pairs, whose scatter then underestimates that of the gains; the
    # scatter of few groups is hardly known.
    if found.errors.gain_variances or groups < MIN_BLOCKS:
        covariance = at_least(covariance, solution.precision)
    n = len(model.response_basis)
    covariance[:n, :n] += np.outer(predict.error_by_noise, predict.error_by_noise)
    centre = model.vignette_basis.centre(model.split(found.parameters)[1])
    return Fit(
        model.response_basis,
        model.vignette_basis,
        model.effects,
        parameters=found.parameters,
        covariance=covariance,
        chance=np.asarray(np.linalg.inv(solution.precision), dtype=np.float64),
        errors=found.errors,
        hyperparameters=found.hyperparameters,
        points=int(np.count_nonzero(observations.combined(np.add, found.weight))),
        groups=groups,
        pixel_noise=predict.pixel_noise,
        texture_share=found.texture_share,
        measured_radius=measured_radius(observations, centre),
    )
