"""The latent radiance of every scene point, and the observations linearised about the grey levels it predicts.

A point of log radiance u gives h(M) = u + ln e + ln V(x), with h = ln g; its u is estimated by the weighted mean over
its observations. The model is linearised at the grey levels that u predicts, not at the noisy measured ones. The rows
of the linear system then depend on the model and the exposures only, their noise is orthogonal to that of the
right-hand side, and the fit is not attenuated. This is orthogonal distance regression in grey levels, or maximum
likelihood with latent irradiance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.noisy_mean import mean_shift
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.texture import TextureShift
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.settings.estimation import (
    DARKEST_GREY,
    LATENT_ITERATIONS,
    MAX_DEVIATION_SIGMAS,
    MIN_ONE_MINUS_LEVERAGE,
    PIXEL_NOISE_STRIDE,
)


@dataclass(frozen=True)
class Latent:
    """The observations, linearised with the current model.

    Attributes
    ----------
    index
        Index of the predicted grey level in the basis's grid, shape (n,).
    grey
        Predicted grey level, shape (n,).
    log_response_slope
        dh/dM at the predicted grey level, shape (n,).
    linear_log
        h at the measured grey level, linearised at the predicted one, shape (n,).
    precision
        One over the variance of h, shape (n,).
    residual
        linear_log − ln e − ln V − u, shape (n,).
    studentised
        Residual over its standard deviation, which accounts for the leverage, shape (n,).
    one_minus_leverage
        One minus the leverage, shape (n,).
    texture
        What the texture lowers h by, if all of the variance seen is texture, shape (n,).
    """

    index: IntArray
    grey: FloatArray
    log_response_slope: FloatArray
    linear_log: FloatArray
    precision: FloatArray
    residual: FloatArray
    studentised: FloatArray
    one_minus_leverage: FloatArray
    texture: FloatArray


@dataclass(frozen=True)
class LatentModel:
    """Linearises observations with a response, a vignette and an error model.

    Attributes
    ----------
    basis
        Basis of the response.
    coefficients
        Coefficients of the response.
    errors
        Error model of the observations.
    noise
        Noise of the single pixels that an observation is a mean of: clipped, it shifts the mean near black and white.
        None where an observation is a single pixel; the error model then describes its noise.
    texture_share
        Share of the shift by texture that is taken out.
    trusted
        Whether the model is good enough to predict grey levels; otherwise it is linearised at the measured ones.
    """

    basis: ResponseBasis
    coefficients: FloatArray
    errors: ErrorModel
    noise: NoiseModel | None
    texture_share: float
    trusted: bool

    def __call__(self, observations: ExposedObservations, log_vignette: FloatArray, weight: FloatArray) -> Latent:
        """Return the linearised observations.

        Parameters
        ----------
        observations
            The observations.
        log_vignette
            ln V of each observation, shape (n,).
        weight
            Robust weights, shape (n,).
        """
        measured = np.clip(observations.grey, DARKEST_GREY, 1.0)
        offset = observations.log_exposure + log_vignette
        state = self._linearised(measured, measured, offset, weight, observations)
        if self.trusted:
            for _ in range(LATENT_ITERATIONS):
                near = MAX_DEVIATION_SIGMAS / (state.log_response_slope * np.sqrt(state.precision))
                predicted = np.interp(state.mean + offset, self.log_response, self.basis.grid)
                grey = np.clip(predicted, measured - near, measured + near)
                state = self._linearised(measured, grey, offset, weight, observations)
        residual = state.linear_log - offset - state.mean
        one_minus_leverage = np.clip(
            1 - weight * state.precision / np.maximum(state.total, 1e-300), MIN_ONE_MINUS_LEVERAGE, 1
        )
        return Latent(
            index=state.index,
            grey=state.grey,
            log_response_slope=state.log_response_slope,
            linear_log=state.linear_log,
            precision=state.precision,
            residual=residual,
            studentised=residual * np.sqrt(state.precision / one_minus_leverage),
            one_minus_leverage=one_minus_leverage,
            texture=state.texture,
        )

    @cached_property
    def log_response(self) -> FloatArray:
        """The logarithm h of g on the basis's grid."""
        return self.basis.log_of(self.coefficients)

    @cached_property
    def _log_response_slope(self) -> FloatArray:
        return self.basis.gamma_of(self.coefficients) / np.maximum(self.basis.grid, DARKEST_GREY)

    @cached_property
    def _irradiance(self) -> FloatArray:
        return np.maximum(np.exp(self.log_response), 1e-12)

    @cached_property
    def _mean_shift(self) -> FloatArray:
        return mean_shift(self.basis.grid, self.log_response, self.pixel_noise)

    @cached_property
    def _texture_shift(self) -> TextureShift:
        return TextureShift.of(self.basis, self.coefficients, self.pixel_noise)

    @cached_property
    def pixel_noise(self) -> NoiseModel:
        """Noise of single pixels."""
        if self.noise is not None:
            return self.noise
        grid = slice(None, None, PIXEL_NOISE_STRIDE)
        slope = 1 / np.maximum(self._log_response_slope[grid], 1e-12)
        variance = self.errors.variance(self.basis.grid[grid], slope, self._irradiance[grid], np.zeros(1))
        return NoiseModel(0.0, 0.0, tuple(variance))

    def _linearised(
        self,
        measured: FloatArray,
        grey: FloatArray,
        offset: FloatArray,
        weight: FloatArray,
        observations: ExposedObservations,
    ) -> _Linearised:
        # The grid is much finer than the noise, so the nearest grid point serves as the point of linearisation.
        index = self.basis.index_of(grey)
        level, log_response_slope = self.basis.grid[index], self._log_response_slope[index]
        excess, texture = measured - level, np.zeros(len(measured))
        if self.trusted:
            # Neither noise nor texture leave the mean of pixels at the grey level of their mean irradiance.
            texture = self._texture_shift(observations, index)
            excess = excess - self._mean_shift[index] + self.texture_share * texture
        linear_log = self.log_response[index] + log_response_slope * excess
        variance = self.errors.variance(level, 1 / log_response_slope, self._irradiance[index], observations.gradient)
        precision = 1 / (variance * log_response_slope**2)
        total, mean = weighted_means(linear_log - offset, weight * precision, observations)
        return _Linearised(
            index, level, log_response_slope, linear_log, precision, total, mean, log_response_slope * texture
        )


@dataclass(frozen=True)
class _Linearised:
    index: IntArray
    grey: FloatArray
    log_response_slope: FloatArray
    linear_log: FloatArray
    precision: FloatArray
    total: FloatArray
    mean: FloatArray
    texture: FloatArray


def weighted_means(
    values: FloatArray, weights: FloatArray, observations: ExposedObservations
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
        Shapes (n,) and that of ``values``; the mean is zero where all weights of a point are.
    """
    columns = values if values.ndim == 2 else values[:, None]
    weighted = columns * weights[:, None]
    counts = observations.counts
    if len(counts) and np.all(counts == counts[0]):
        # Pairs and static series have the same number of observations of every point: plain sums are faster.
        shape = (len(counts), counts[0])
        total = weights.reshape(shape).sum(axis=1)
        mean = weighted.reshape(*shape, -1).sum(axis=1)
    else:
        total = np.add.reduceat(weights, observations.starts)
        mean = np.add.reduceat(weighted, observations.starts, axis=0)
    mean /= np.maximum(total, 1e-300)[:, None]
    return np.repeat(total, counts), np.repeat(mean, counts, axis=0).reshape(values.shape)


def refitted_share(share: float, latent: Latent, weight: FloatArray, observations: ExposedObservations) -> float:
    """Return the share of the shift by texture that the residuals show, by weighted least squares, from 0 to 1.

    Not all of the variance beside noise is texture of the scene: sharpening, compression and noise that neighbours
    share add to it. The shift of a power law is alike for all observations of a point and leaves the share open.

    Parameters
    ----------
    share
        The share that was taken out of the linearised observations.
    latent
        The linearised observations, n of them.
    weight
        Their robust weights, shape (n,).
    observations
        The observations.
    """
    weight = weight * latent.precision
    shift = latent.texture - weighted_means(latent.texture, weight, observations)[1]
    square = float(weight @ shift**2)
    missing = -float(weight @ (shift * latent.residual)) / square if square > 0 else 0.0
    return float(np.clip(share + missing, 0.0, 1.0))
