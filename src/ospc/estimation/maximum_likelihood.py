"""Joint fit of response and vignette to all observations: robust maximum likelihood with latent irradiance.

The first round is a convex problem, a non-negative least squares fit. Each further round repeats it with the model
linearised at the grey levels predicted by the previous round, with robust weights, an error model fitted to the
residuals, and a new choice of the strength of the prior.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.estimation.effects import Effects
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.latent import Latent, LatentModel
from ospc.estimation.model import LinearSystem, Model
from ospc.estimation.normal_equations import NormalEquations, at_least
from ospc.estimation.prior import START
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis, measured_radius
from ospc.library_threads import one_blas_thread
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.robust import robust_scale
from ospc.settings.estimation import (
    CLEAR_OF_ENDS_SIGMAS,
    CONVEX_ROUNDS,
    MAX_DARK_CLEARANCE,
    MIN_BLOCKS,
    MIN_SANDWICH_FACTOR,
    SETTLED_SIGMAS,
    TEXTURE_SHARE_INFORMATION,
    WEIGHT_CUT_SIGMAS,
    WEIGHT_SCALE_SIGMAS,
)


@dataclass(frozen=True)
class Fitted:
    """A fit with its observations and pixel noise, from which several other models are tried."""

    fit: Fit
    observations: ExposedObservations
    noise: NoiseModel | None

    @cached_property
    def weighted(self) -> tuple[Latent, FloatArray, float]:
        """The observations linearised about the fit, with their robust weights and sandwich factor."""
        fit = self.fit
        log_gain = fit.log_gain(
            fit.parameters, self.observations, fit.response_basis.index_of(self.observations.grey)
        )
        first = self._predict(self.observations, log_gain, np.ones(len(self.observations)))
        weight, _ = _redescending(first, _unclipped(first, self._predict.pixel_noise))
        del first  # it takes as much memory as the observations
        # Repeat with radiances no longer biased by outliers.
        latent = self._predict(self.observations, log_gain, weight)
        return latent, *_redescending(latent, _unclipped(latent, self._predict.pixel_noise))

    @property
    def log_response(self) -> FloatArray:
        """The logarithm of the fitted response on the basis's grid."""
        return self._predict.log_response

    @cached_property
    def _predict(self) -> LatentModel:
        fit = self.fit
        return LatentModel(
            fit.response_basis, fit.response_parameters, fit.errors, self.noise, fit.texture_share, trusted=True
        )


@dataclass(frozen=True)
class MaximumLikelihoodEstimator:
    """Fits response, vignette and effects to observations.

    Attributes
    ----------
    response_basis, vignette_basis, effects
        The model.
    noise
        Noise of single pixels, by which clipping biases the mean near the ends. None if the observations are single
        pixels.
    rounds
        Maximum number of rounds after the first; the fit ends earlier once no parameter moves by more than about a
        tenth of a standard deviation.
    """

    response_basis: ResponseBasis
    vignette_basis: VignetteBasis
    noise: NoiseModel | None = None
    rounds: int = 8
    effects: Effects = field(default_factory=Effects)

    @property
    def model(self) -> Model:
        """The model that is fitted."""
        return Model(self.response_basis, self.vignette_basis, self.effects)

    def fit(self, observations: ExposedObservations, start: Fit | None = None) -> Fit:
        """Fit the model, starting from an earlier fit with the same response basis if there is one.

        It uses one core: threads slow down its many small matrix products.
        """
        with one_blas_thread():
            return self._fit(observations, start)

    def _fit(self, observations: ExposedObservations, start: Fit | None) -> Fit:
        model = self.model
        parameters = self.model.typical if start is None else self.parameters_of(start)
        errors, texture_share = (start.errors, start.texture_share) if start else (ErrorModel(), 0.0)
        hyperparameters = start.hyperparameters if start else START
        weight, sandwich_factor = np.ones(len(observations)), 1.0
        index = self.response_basis.index_of(observations.grey)
        for round_number in range(self.rounds + 1):
            convex = start is None and round_number < CONVEX_ROUNDS
            trusted = round_number > 0 or start is not None
            gamma = model.split(parameters)[0]
            predict = LatentModel(self.response_basis, gamma, errors, self.noise, texture_share, trusted)
            latent = predict(observations, model.log_gain(parameters, observations, index), weight)
            index = latent.index
            if trusted:
                unclipped = _unclipped(latent, predict.pixel_noise)
                weight = unclipped.astype(np.float64)
                if not convex:
                    weight, sandwich_factor = _redescending(latent, unclipped)
                errors = errors.refitted(
                    latent.residual**2 / latent.one_minus_leverage / latent.log_response_slope**2,
                    latent.grey,
                    1 / latent.log_response_slope,
                    latent.irradiance,
                    observations.gradient,
                )
            system = LinearSystem(model, parameters, observations, latent, weight, errors.gain_variances)
            prior = model.prior(parameters)
            of_prior = prior.precision(hyperparameters)
            with_share = system.equations(of_prior, sandwich_factor)
            equations = with_share.part(np.arange(len(parameters))).scaled(of_prior, sandwich_factor)
            if trusted:
                in_units = of_prior / equations.information_scale
                change = with_share.last_fitted(in_units, prior.mean, TEXTURE_SHARE_INFORMATION, 1 - texture_share)
                texture_share = float(np.clip(texture_share + change, 0.0, 1.0))
            hyperparameters = equations.maximize_evidence(prior, hyperparameters)
            parameters = model.limited(equations.solve(prior, hyperparameters, model.floor), system.about)
            precision = equations.posterior_precision(prior, hyperparameters)
            moved = parameters - system.about
            if system.has_gains:
                errors = replace(errors, gain_variances=system.gains(parameters).refitted_variances)
            settled = round_number > 1 and float(moved @ precision @ moved) < SETTLED_SIGMAS**2 * len(moved)
            if settled or round_number == self.rounds:
                disagreement = system.disagreement(parameters, of_prior, sandwich_factor)
                break
            del latent, system  # both take as much memory as the observations
        covariance = equations.covariance(prior, hyperparameters, disagreement)
        chance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        groups = len(np.unique(observations.group))
        # Fitted gain variances follow the means of pairs, whose scatter then underestimates that of the gains; the
        # scatter of few groups is hardly known.
        if errors.gain_variances or groups < MIN_BLOCKS:
            covariance = at_least(covariance, precision)
        n = len(self.response_basis)
        covariance[:n, :n] += np.outer(predict.error_by_noise, predict.error_by_noise)
        return Fit(
            self.response_basis,
            self.vignette_basis,
            self.effects,
            parameters,
            covariance,
            chance,
            errors,
            hyperparameters,
            int(np.count_nonzero(observations.combined(np.add, weight))),
            groups,
            predict.pixel_noise,
            texture_share,
            measured_radius(observations, self.vignette_basis.centre(model.split(parameters)[1])),
        )

    def information(self, observations: ExposedObservations, fit: Fit, about: FloatArray) -> NormalEquations:
        """Return the information of the observations about the parameters of this model, without a prior.

        Parameters
        ----------
        observations
            The observations.
        fit
            Fit to them, possibly of another model, from which response and error model are taken.
        about
            The same fit in parameters of this model, at which it is linearised, shape (p,).
        """
        return self._information(Fitted(fit, observations, self.noise), about)

    def _information(self, fitted: Fitted, about: FloatArray) -> NormalEquations:
        with one_blas_thread():
            system, sandwich_factor = self._system(fitted, about)
            precision = self.model.prior(about).precision(fitted.fit.hyperparameters)
            equations = system.equations(precision, sandwich_factor)
            return equations.part(np.arange(len(about))).scaled(precision, sandwich_factor)

    def significant_gain_variances(self, fitted: Fitted) -> tuple[float, ...]:
        """Return the variances of latent gains that pairs of frames show beyond chance, given a fit of this model."""
        fit = fitted.fit
        with one_blas_thread():
            system, sandwich_factor = self._system(fitted, fit.parameters)
            precision = self.model.prior(fit.parameters).precision(fit.hyperparameters)
            return system.significant_gain_variances(precision, sandwich_factor)

    def _system(self, fitted: Fitted, about: FloatArray) -> tuple[LinearSystem, float]:
        """Return the linear system about a fit, and the sandwich factor of its weights."""
        latent, weight, sandwich_factor = fitted.weighted
        # This basis may not contain the fitted response exactly: refer the linearised values to the closest one.
        here = self.response_basis.log_of(self.model.split(about)[0])
        latent = replace(latent, linear_log=latent.linear_log + (here - fitted.log_response)[latent.index])
        gain_variances = fitted.fit.errors.gain_variances
        return LinearSystem(self.model, about, fitted.observations, latent, weight, gain_variances), sandwich_factor

    def newton_steps(
        self, fitted: Fitted, about: FloatArray, choices: Iterable[IntArray]
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Take one Newton step from a fit for each of several subsets of this model's parameters.

        The fit is linearised as in :meth:`information`. A subset is given by the indices of m parameters; the others
        stay zero.

        Yields
        ------
        The parameters of a subset after the step, shape (m,), and their covariance by chance, (m, m).
        """
        equations = self._information(fitted, about).centred(about)
        prior = self.model.prior(about)
        precision = prior.precision(fitted.fit.hyperparameters)
        for chosen in choices:
            yield equations.part(chosen).newton_step(precision[np.ix_(chosen, chosen)], prior.mean[chosen])

    def parameters_of(self, start: Fit) -> FloatArray:
        """Convert the parameters of a fit with the same response basis to this model, shape (p,)."""
        vignette = self.vignette_basis.conversion(start.vignette_basis) @ start.vignette_parameters
        known = dict(zip(start.effects.chosen, start.effect_parameters, strict=True))
        effects = [known.get(effect, 0.0) for effect in self.effects.chosen]
        return np.concatenate([start.response_parameters, vignette, effects])


def _redescending(latent: Latent, unclipped: BoolArray) -> tuple[FloatArray, float]:
    """Return redescending weights (Geman and McClure 1987, truncated), and E[ψ'] / E[w] of the non-zero ones."""
    scaled = latent.studentised / (WEIGHT_SCALE_SIGMAS * max(robust_scale(latent.studentised), 1e-6))
    squared = scaled**2
    counts = unclipped & (np.abs(scaled) < WEIGHT_CUT_SIGMAS / WEIGHT_SCALE_SIGMAS)
    weight = np.where(counts, 1 / (1 + squared) ** 2, 0.0)
    derivative = np.where(counts, (1 - 3 * squared) / (1 + squared) ** 3, 0.0)
    sandwich_factor = float(derivative.sum() / max(weight.sum(), 1e-300))
    return weight, max(sandwich_factor, MIN_SANDWICH_FACTOR)


def _unclipped(latent: Latent, noise: NoiseModel) -> BoolArray:
    """Return where the noise of single pixels hardly reaches black or white, given the predicted grey level.

    Using the measured grey level would select samples whose noise happens to point away from the end.
    """
    reach = CLEAR_OF_ENDS_SIGMAS * np.sqrt(noise.variance(latent.grey))
    return np.asarray((latent.grey + reach < 1.0) & (latent.grey > np.minimum(reach, MAX_DARK_CLEARANCE)))
