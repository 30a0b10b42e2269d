"""The latent radiance of each scene point, and the observations linearised at the grey levels that it predicts.

A point of log radiance u satisfies h(M) = u + ln e + ln V(x), with h = ln g; u is estimated by the weighted mean over
its observations. The model is linearised at the grey levels predicted by u rather than at the noisy measured ones.
The rows of the linear system then depend only on the model and the exposures, their noise is orthogonal to that of
the right-hand side, and the fit has no attenuation bias. This is orthogonal distance regression in grey levels, or
maximum likelihood with latent irradiance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.frame_gains import FrameGains, PairEnds, PairMeans
from ospc.estimation.mean_of_pixels import PixelMeans
from ospc.estimation.response_basis import ResponseBasis
from ospc.numerics.robust import VARIANCE_OF_MEDIAN, medians
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.settings.error_model import (
    DARKEST_GREY,
    LATENT_ITERATIONS,
    MAX_DEVIATION_SIGMAS,
    MIN_ONE_MINUS_LEVERAGE,
    NOISE_SHARE_SIGMA,
    PIXEL_NOISE_STRIDE,
)
from ospc.settings.fit import CLEAR_OF_ENDS_SIGMAS, MAX_DARK_CLEARANCE
from ospc.settings.residuals import MOST_LOG_GAIN


@dataclass(frozen=True)
class Latent:
    """The observations, linearised with the current model, shape (n,) each."""

    index: IntArray
    """Index of the predicted grey level in the basis's grid."""
    grey: FloatArray
    """Predicted grey level."""
    log_response_slope: FloatArray
    """dh/dM at that grey level."""
    irradiance: FloatArray
    """g at that grey level."""
    linear_log: FloatArray
    """h at the measured grey level, linearised at the predicted one."""
    precision: FloatArray
    """Inverse variance of h."""
    weight: FloatArray
    """Robust weight; 1 if all observations of a point have none."""
    texture: FloatArray
    """Reduction of h by texture if all of the measured variance is texture, with the same variance over squared grey
    level for all observations of a point."""
    log_exposure: FloatArray
    """ln of the effective exposure: the stated one plus the latent gain of the frame."""
    offset: FloatArray
    """``log_exposure`` plus ln of the gain by vignette and effects."""
    total: FloatArray
    """Sum of the point's weights."""
    mean: FloatArray
    """The point's log radiance u."""

    @cached_property
    def residual(self) -> FloatArray:
        """linear_log − offset − u."""
        return self.linear_log - self.offset - self.mean

    @cached_property
    def one_minus_leverage(self) -> FloatArray:
        """One minus the leverage, limited from below."""
        leverage = self.weight * self.precision / np.maximum(self.total, 1e-300)
        return np.clip(1 - leverage, MIN_ONE_MINUS_LEVERAGE, 1)

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard deviation of the residual, corrected for the leverage."""
        return np.sqrt(self.one_minus_leverage / self.precision)

    @cached_property
    def studentised(self) -> FloatArray:
        """Residual over its standard deviation."""
        return self.residual / self.sigma

    def means_of_pairs(self, observations: ExposedObservations, used: BoolArray | None = None) -> PairMeans:
        """Return the mean residuals of pairs if no frame had a gain, from points whose observations are both used.

        The mean is a median, because weights computed without gains would discard whole pairs. Pairs without such
        points are left out.
        """
        residual = self.linear_log - self.offset + self.log_exposure - observations.log_exposure
        pair, difference = observations.group_number[0::2], residual[0::2] - residual[1::2]
        information = 1 / (1 / self.precision[0::2] + 1 / self.precision[1::2])
        if used is not None:
            both = used[0::2] & used[1::2]
            difference, information = difference[both], information[both]
            pair = np.unique(pair[both], return_inverse=True)[1]
        return PairMeans(medians(difference, pair), VARIANCE_OF_MEDIAN / np.bincount(pair, information))


@dataclass(frozen=True)
class LatentModel:
    """Linearises observations with a response and an error model."""

    basis: ResponseBasis
    coefficients: FloatArray
    """The response."""
    errors: ErrorModel
    """Error model of the observations."""
    noise: NoiseModel | None
    """Noise of the single pixels averaged in an observation; because it is clipped, it shifts the mean near black and
    white. None if an observation is a single pixel, whose noise the error model describes."""
    texture_share: float
    """Share of the texture shift that is corrected."""
    trusted: bool
    """Whether the model is good enough to predict grey levels; otherwise it is linearised at the measured ones."""

    def __call__(self, observations: ExposedObservations, log_gain: FloatArray, weight: FloatArray) -> Latent:
        """Linearise observations, given ln of the gain by vignette and effects, and weights, shape (n,) each.

        A point whose observations all have no weight is linearised as if each had weight 1.
        """
        # Otherwise it would have no radiance to compare it with, and could never get a weight again.
        has_weight = np.repeat(observations.combined(np.add, weight) > 0, observations.counts)
        weight = np.where(has_weight, weight, 1.0)
        measured = np.clip(observations.grey, DARKEST_GREY, 1.0)
        latent = self._linearised(observations, measured, observations.log_exposure, log_gain, weight)
        for _ in range(LATENT_ITERATIONS if self.trusted else 0):
            if self.errors.gain_variances and observations.in_pairs:
                log_exposure = observations.log_exposure + self._log_gain_of_frames(observations, latent)
                latent = self._linearised(observations, latent.grey, log_exposure, log_gain, weight)
            # Stay near the measured grey level after correction for texture and noise, which may shift it farther.
            near = MAX_DEVIATION_SIGMAS / np.sqrt(latent.precision)
            expected_log = latent.linear_log + np.clip(-latent.residual, -near, near)
            # One Newton step: looking up all values in the table takes five times as long.
            grey = latent.grey + (expected_log - self.log_response[latent.index]) / latent.log_response_slope
            latent = self._linearised(observations, grey, latent.log_exposure, log_gain, weight)
        return self._with_texture(observations, latent) if self.trusted else latent

    def unclipped(self, observations: ExposedObservations, latent: Latent) -> BoolArray:
        """Return where the noise of single pixels hardly reaches black or white, given the predicted grey level.

        Using the measured grey level would select samples whose noise happens to point away from the end.
        """
        shifts = self._pixel_means.at(observations, latent.index)
        clearance = CLEAR_OF_ENDS_SIGMAS * np.sqrt(shifts.variance_of_noise)
        return np.asarray((latent.grey + clearance < 1.0) & (latent.grey > np.minimum(clearance, MAX_DARK_CLEARANCE)))

    def _with_texture(self, observations: ExposedObservations, latent: Latent) -> Latent:
        """Return the observations with their reduction by texture, which only the linear system needs."""
        means = self._pixel_means
        texture = means.at(observations, latent.index).texture
        by_point = np.stack([texture, observations.grey_skewness], axis=1)
        texture, skewness = weighted_means(by_point, np.ones(len(by_point)), observations)[1].T
        decrease = means.by_texture(texture, skewness, latent.index)
        return replace(latent, texture=latent.log_response_slope * decrease)

    def _log_gain_of_frames(self, observations: ExposedObservations, latent: Latent) -> FloatArray:
        """Return the latent gain of each observation's frame, shape (n,)."""
        means = latent.means_of_pairs(observations)
        gains = FrameGains(PairEnds.of(observations), means, self.errors.gain_variances)
        gain = np.clip(gains.of_ends, -MOST_LOG_GAIN, MOST_LOG_GAIN)
        return gain[:, observations.group_number[0::2]].T.ravel()

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
    def _flat_variance(self) -> tuple[FloatArray, FloatArray]:
        return self.errors.flat_variance(self.basis.grid, 1 / self._log_response_slope, self._irradiance)

    @cached_property
    def _pixel_means(self) -> PixelMeans:
        return PixelMeans.of(self.basis, self.coefficients, self.pixel_noise)

    @cached_property
    def error_by_noise(self) -> FloatArray:
        """Error of the coefficients if a part of the noise is added after the response, shape (len(basis),).

        The share that is added before, and bent by the response, is then wrong by its standard deviation.
        """
        # Below half an interval between knots, the shift of clipped noise may have any slope.
        levels = slice(len(self.basis.grid) // (2 * self.basis.intervals), None, PIXEL_NOISE_STRIDE)
        shift = NOISE_SHARE_SIGMA * (self._pixel_means.by_noise * self._log_response_slope)[levels]
        return np.asarray(np.linalg.lstsq(self.basis.log_table[levels], shift, rcond=None)[0])

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
        observations: ExposedObservations,
        grey: FloatArray,
        log_exposure: FloatArray,
        log_gain: FloatArray,
        weight: FloatArray,
    ) -> Latent:
        # The grid is much finer than the noise, so the nearest grid point serves as the point of linearisation.
        index = self.basis.index_of(grey)
        level, slope, irradiance = self.basis.grid[index], self._log_response_slope[index], self._irradiance[index]
        excess = np.clip(observations.grey, DARKEST_GREY, 1.0) - level
        flat, factor = (table[index] for table in self._flat_variance)
        variance = self.errors.with_gradient(flat, factor, observations.gradient)
        if self.trusted:
            # Noise and texture shift the mean of pixels away from the grey level of their mean irradiance.
            shifts = self._pixel_means.at(observations, index)
            excess = shifts.corrected(excess, self.texture_share)
            variance = variance + self.texture_share**2 * shifts.error_variance
        linear_log = self.log_response[index] + slope * excess
        precision, offset, zero = 1 / (variance * slope**2), log_exposure + log_gain, np.zeros(len(level))
        total, mean = weighted_means(linear_log - offset, weight * precision, observations)
        return Latent(
            index, level, slope, irradiance, linear_log, precision, weight, zero, log_exposure, offset, total, mean
        )


def weighted_means(
    values: FloatArray, weights: FloatArray, observations: ExposedObservations
) -> tuple[FloatArray, FloatArray]:
    """Return each point's sum of weights and weighted mean of values, repeated for its observations.

    Values have shape (n,) or (n, p), weights (n,). The mean is zero if all weights of a point are zero.
    """
    columns = values if values.ndim == 2 else values[:, None]
    weighted = columns * weights[:, None]
    counts = observations.counts
    total, mean = (observations.combined(np.add, each) for each in (weights, weighted))
    mean /= np.maximum(total, 1e-300)[:, None]
    return np.repeat(total, counts), np.repeat(mean, counts, axis=0).reshape(values.shape)
