"""A fit together with what it was fitted to: linearised about it, the observations show what other models give."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.estimation.fit import Fit
from ospc.estimation.latent import Latent, LatentModel
from ospc.estimation.model import LinearSystem, Model
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.robust_weights import redescending_weights
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.system.library_threads import one_blas_thread


@dataclass(frozen=True)
class Fitted:
    """A fit with its observations and pixel noise, from which several other models are tried.

    ``registered`` has, beside the observations, those of pairs that were left out because their exposures are wrong;
    None if there are none.
    """

    fit: Fit
    observations: ExposedObservations
    noise: NoiseModel | None
    registered: ExposedObservations | None = None

    @property
    def compared(self) -> ExposedObservations:
        """The observations of all pairs whose exposure ratios are estimated, even of wrong exposures."""
        return self.observations if self.registered is None else self.registered

    def information(self, model: Model, about: FloatArray) -> NormalEquations:
        """Return the information of the observations about the parameters of a model, without a prior.

        Response and error model are taken from the fit, possibly of another model. ``about`` is the same fit in
        parameters of the model, at which it is linearised, shape (p,).
        """
        with one_blas_thread():
            system, sandwich_factor = self._linearised(model, about)
            precision = model.prior(about).precision(self.fit.hyperparameters)
            equations = system.equations(precision, sandwich_factor)
            return equations.part(np.arange(len(about))).scaled(precision, sandwich_factor)

    def newton_steps(
        self, model: Model, about: FloatArray, choices: Iterable[IntArray]
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Take one Newton step from the fit for each of several subsets of a model's parameters.

        It is linearised as in :meth:`information`. A subset is given by the indices of m parameters; the others stay
        zero.

        Yields
        ------
        The parameters of a subset after the step, shape (m,), and their covariance due to chance, (m, m).
        """
        equations = self.information(model, about).centred(about)
        prior = model.prior(about)
        precision = prior.precision(self.fit.hyperparameters)
        for chosen in choices:
            yield equations.part(chosen).newton_step(precision[np.ix_(chosen, chosen)], prior.mean[chosen])

    @property
    def significant_gain_variances(self) -> tuple[float, ...]:
        """Variances of latent gains that pairs of frames show beyond chance; empty if chance explains the pairs."""
        fit = self.fit
        with one_blas_thread():
            system, sandwich_factor = self._linearised(fit, fit.parameters)
            precision = fit.prior(fit.parameters).precision(fit.hyperparameters)
            return system.significant_gain_variances(precision, sandwich_factor, fit.resolves(self.observations))

    def _linearised(self, model: Model, about: FloatArray) -> tuple[LinearSystem, float]:
        """Return the linear system of a model about the fit, and the sandwich factor of its weights."""
        latent, weight, sandwich_factor = self.weighted
        # This basis may not contain the fitted response exactly: refer the linearised values to the closest one.
        here = model.response_basis.log_of(model.split(about)[0])
        latent = replace(latent, linear_log=latent.linear_log + (here - self.log_response)[latent.index])
        gain_variances = self.fit.errors.gain_variances
        return LinearSystem(model, about, self.observations, latent, weight, gain_variances), sandwich_factor

    @cached_property
    def weighted(self) -> tuple[Latent, FloatArray, float]:
        """The observations linearised about the fit, with their robust weights and sandwich factor."""
        fit = self.fit
        log_gain = fit.log_gain(
            fit.parameters, self.observations, fit.response_basis.index_of(self.observations.grey)
        )
        first = self._predict(self.observations, log_gain, np.ones(len(self.observations)))
        weight, _ = redescending_weights(first.studentised, self._predict.unclipped(self.observations, first))
        del first  # it takes as much memory as the observations
        # Repeat with radiances no longer biased by outliers.
        latent = self._predict(self.observations, log_gain, weight)
        unclipped = self._predict.unclipped(self.observations, latent)
        weight, sandwich_factor = redescending_weights(latent.studentised, unclipped)
        return latent, weight, sandwich_factor / self.observations.error_factor

    @cached_property
    def unclipped(self) -> BoolArray:
        """Where the noise of single pixels hardly reaches black or white, shape (n,)."""
        return self._predict.unclipped(self.observations, self.weighted[0])

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
