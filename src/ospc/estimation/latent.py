"""The radiance of every scene point, eliminated: what the observations say given response and vignette.

A point of log radiance u shows h(M) = u + ln e + ln V(x), with h = ln g. Its u is the weighted mean over its
observations. The model is linearised at the grey levels that u predicts, not at the noisy ones measured. The rows of
the linear system are then functions of the model and the exposures, their noise is orthogonal to that of the
right-hand side, and the fit is not attenuated: this is the orthogonal distance in grey levels, or maximum likelihood
with latent irradiance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.noisy_mean import mean_shift
from ospc.estimation.response_basis import ResponseBasis
from ospc.observations import Observations
from ospc.photometry.noise import NoiseModel

DARKEST = 0.25 / 255
"""Lowest grey level with a logarithm of its own."""

_FARTHEST = 6.0
_ITERATIONS = 3


@dataclass(frozen=True)
class Latent:
    """The observations as the current model sees them.

    Attributes
    ----------
    index
        Index into the basis's grid of the grey level the model predicts, shape (n,).
    grey
        That grey level, shape (n,).
    log_response_slope
        dh/dM there, shape (n,).
    linear_log
        h at the measured grey level, linearised at the predicted one, shape (n,).
    precision
        One over the variance of h, shape (n,).
    weight
        Robust weight of each observation, shape (n,).
    residual
        linear_log − ln e − ln V − u, shape (n,).
    studentised
        Residual over its standard deviation, leverage taken into account, shape (n,).
    one_minus_leverage
        One minus the leverage, shape (n,).
    """

    index: IntArray
    grey: FloatArray
    log_response_slope: FloatArray
    linear_log: FloatArray
    precision: FloatArray
    weight: FloatArray
    residual: FloatArray
    studentised: FloatArray
    one_minus_leverage: FloatArray


@dataclass(frozen=True)
class LatentModel:
    """Predicts the observations from a response, a vignette and an error model.

    Attributes
    ----------
    basis
        The response's basis.
    log_response
        h on the basis's grid.
    gamma
        γ on the basis's grid.
    errors
        Error model of the observations.
    noise
        Noise of the single pixels behind an observation: clipping it shifts means near black and white. None where an
        observation is a single pixel, so that the error model tells.
    trusted
        Whether the model is good enough to predict; otherwise it is linearised at the measured grey levels.
    """

    basis: ResponseBasis
    log_response: FloatArray
    gamma: FloatArray
    errors: ErrorModel
    noise: NoiseModel | None
    trusted: bool

    def __call__(self, observations: Observations, log_vignette: FloatArray, weight: FloatArray) -> Latent:
        """Return the observations as the model sees them.

        Parameters
        ----------
        observations
            The observations.
        log_vignette
            ln V of each observation, shape (n,).
        weight
            Robust weights, shape (n,).
        """
        measured = np.clip(observations.grey, DARKEST, 1.0)
        offset = observations.log_exposure + log_vignette
        state = self._linearised(measured, measured, offset, weight, observations)
        if self.trusted:
            for _ in range(_ITERATIONS):
                near = _FARTHEST / (state.log_response_slope * np.sqrt(state.precision))
                predicted = np.interp(state.mean + offset, self.log_response, self.basis.grid)
                grey = np.clip(predicted, measured - near, measured + near)
                state = self._linearised(measured, grey, offset, weight, observations)
        residual = state.linear_log - offset - state.mean
        one_minus_leverage = np.clip(1 - weight * state.precision / np.maximum(state.total, 1e-300), 1e-3, 1)
        return Latent(
            index=state.index,
            grey=state.grey,
            log_response_slope=state.log_response_slope,
            linear_log=state.linear_log,
            precision=state.precision,
            weight=weight,
            residual=residual,
            studentised=residual * np.sqrt(state.precision / one_minus_leverage),
            one_minus_leverage=one_minus_leverage,
        )

    @cached_property
    def _log_response_slope(self) -> FloatArray:
        return self.gamma / np.maximum(self.basis.grid, DARKEST)

    @cached_property
    def _irradiance(self) -> FloatArray:
        return np.maximum(np.exp(self.log_response), 1e-12)

    @cached_property
    def _mean_shift(self) -> FloatArray:
        return mean_shift(self.basis.grid, self.log_response, self.pixel_noise)

    @cached_property
    def pixel_noise(self) -> NoiseModel:
        """Noise of single pixels."""
        if self.noise is not None:
            return self.noise
        grid = slice(None, None, 16)
        slope = 1 / np.maximum(self._log_response_slope[grid], 1e-12)
        variance = self.errors.variance(self.basis.grid[grid], slope, self._irradiance[grid], np.zeros(1))
        return NoiseModel(0.0, 0.0, tuple(variance))

    def _linearised(
        self,
        measured: FloatArray,
        grey: FloatArray,
        offset: FloatArray,
        weight: FloatArray,
        observations: Observations,
    ) -> _Linearised:
        # The grid is finer than anything that matters here: its nearest point is as good a place to linearise at.
        index = self.basis.index_of(grey)
        level, log_response_slope = self.basis.grid[index], self._log_response_slope[index]
        excess = measured - level
        if self.trusted:
            excess = excess - self._mean_shift[index]
        linear_log = self.log_response[index] + log_response_slope * excess
        variance = self.errors.variance(level, 1 / log_response_slope, self._irradiance[index], observations.gradient)
        precision = 1 / (variance * log_response_slope**2)
        total, mean = weighted_means(linear_log - offset, weight * precision, observations)
        return _Linearised(index, level, log_response_slope, linear_log, precision, total, mean)


@dataclass(frozen=True)
class _Linearised:
    index: IntArray
    grey: FloatArray
    log_response_slope: FloatArray
    linear_log: FloatArray
    precision: FloatArray
    total: FloatArray
    mean: FloatArray


def weighted_means(
    values: FloatArray, weights: FloatArray, observations: Observations
) -> tuple[FloatArray, FloatArray]:
    """Return each point's sum of weights and weighted mean of values, repeated for its observations.

    Parameters
    ----------
    values
        Shape (n,) or (n, p).
    weights
        Shape (n,).
    observations
        The n observations.

    Returns
    -------
    tuple of FloatArray
        Shapes (n,) and that of ``values``; the mean is zero where all weights are.
    """
    columns = values if values.ndim == 2 else values[:, None]
    weighted = columns * weights[:, None]
    counts = observations.counts
    if len(counts) and np.all(counts == counts[0]):
        # Pairs, and static series, have as many observations of each point: plain sums, no index.
        shape = (len(counts), counts[0])
        total = weights.reshape(shape).sum(axis=1)
        mean = weighted.reshape(*shape, -1).sum(axis=1)
    else:
        total = np.add.reduceat(weights, observations.starts)
        mean = np.add.reduceat(weighted, observations.starts, axis=0)
    mean /= np.maximum(total, 1e-300)[:, None]
    return np.repeat(total, counts), np.repeat(mean, counts, axis=0).reshape(values.shape)
