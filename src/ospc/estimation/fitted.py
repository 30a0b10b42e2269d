"""A fit together with what it was fitted to, from which other models are tried."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.estimation.fit import Fit
from ospc.estimation.latent import Latent, LatentModel
from ospc.estimation.robust_weights import redescending_weights
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel


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
