"""Shift of a mean of pixels away from the grey level of their mean irradiance, due to noise and texture.

A sensor adds noise to the irradiance; the response then bends and clips the sum. Near black, where responses are
steep and the noise is clipped, this shift of the mean would be the largest error if it were not corrected. Noise
added to the grey level itself, by compression or by processing in the camera, is not bent. The dependence of the
pixel variance on the grey level distinguishes the two.

Texture has the same effect, and coarse texture a large one. With a power law it is equal at all exposures of a point.
With other responses, or if one view resolves more of the texture, it is not, and the fit would attribute it to the
response or the vignette. The mean irradiance of the pixels is computed as that of two grey levels with the same mean,
variance and skewness (Gauss quadrature), which is exact if g is a cubic polynomial. At a knee, where that is of
little use, the mean over a normal distribution is computed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.estimation.response_basis import ResponseBasis
from ospc.numerics.least_squares import non_negative_least_squares
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.settings.error_model import (
    DARKEST_GREY,
    MIN_NOISE_IRRADIANCE,
    MIN_NOISE_LEVELS,
    SHIFT_LEVELS,
    SHIFT_QUANTILES,
    UNCLIPPED_SIGMAS,
)
from ospc.settings.fit import (
    BEND_SMOOTHING,
    KNEE_BEND,
    KNEE_LEVELS,
    KNEE_SMOOTHING,
    MAX_NOISE,
    MAX_SHIFT,
    MAX_TEXTURE,
    TEXTURE_ERROR,
    TEXTURE_SPREADS,
    TEXTURE_WIDTHS,
)
from ospc.settings.response import SHOULDER_GREY

_NORMAL = np.array([NormalDist().inv_cdf((i + 0.5) / SHIFT_QUANTILES) for i in range(SHIFT_QUANTILES)])
"""Equally probable values of a standard normal variable, shape (65,)."""

_TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True)
class PixelMeans:
    """The shifts for one response, on the grid of its basis, shape (grid,) each."""

    by_noise: FloatArray
    """Increase of the mean by noise without gain; it grows as the variance does."""
    grid: FloatArray
    """Grey levels."""
    irradiance: FloatArray
    """g, smoothed because bends of an estimate may be chance."""
    log_slope: FloatArray
    """The derivative of ln g, smoothed."""
    bend: FloatArray
    """g″/g′, smoothed."""
    at_knee: FloatArray | None
    """Decrease of the mean by normally distributed texture over its variance, for each of :data:`TEXTURE_WIDTHS`,
    shape (grid, widths); NaN where there is no knee, None if there is none at all."""
    noise_variance: FloatArray
    """Variance of single pixels without gain."""
    noise: NoiseModel
    """The noise model, for the growth with gain."""

    @classmethod
    def of(cls, basis: ResponseBasis, coefficients: FloatArray, noise: NoiseModel) -> PixelMeans:
        """Return the shifts for a response, given by its coefficients, and the noise of single pixels."""
        by_noise, variance = shift_and_variance(basis.grid, basis.log_of(coefficients), noise)
        bend = basis.bend_of(coefficients)
        irradiance = np.exp(basis.smoothed_log_of(coefficients, BEND_SMOOTHING))
        slope = basis.smoothed_slope_of(coefficients, BEND_SMOOTHING)
        # Near white, there are few measurements and a sharp bend may be chance; near black, the window exceeds the
        # scale.
        inner = (basis.grid > BEND_SMOOTHING) & (basis.grid < SHOULDER_GREY)
        sharp = np.abs(basis.bend_of(coefficients, KNEE_SMOOTHING) - bend) > KNEE_BEND
        at_knee = _around(sharp & inner, round(BEND_SMOOTHING * len(basis.grid)))
        decrease = None
        if np.any(at_knee):
            decrease = np.full((len(basis.grid), len(TEXTURE_WIDTHS)), np.nan)
            decrease[at_knee] = _decrease_at_knee(
                basis.grid[at_knee],
                basis.grid,
                basis.smoothed_log_of(coefficients, KNEE_SMOOTHING),
                basis.grid + by_noise,
            )
        return cls(by_noise, basis.grid, irradiance, slope, bend, decrease, variance, noise)

    def at(self, observations: ExposedObservations, index: IntArray) -> ObservedShifts:
        """Return the shifts of observations; ``index`` is the grid index of each one's grey level, shape (n,)."""
        return ObservedShifts(self, observations, index)

    def by_texture(self, texture: FloatArray, skewness: FloatArray, index: IntArray) -> FloatArray:
        """Return the decrease of the mean by texture, (n,), given its variance over the squared grey level.

        Where noise makes the variance negative, so is the decrease: otherwise it would be too large on average.
        """
        decrease = self._by_quadrature(texture, skewness, index)
        if self.at_knee is not None:
            near = np.isfinite(self.at_knee[index, 0])
            decrease[near] = self._by_table(self.at_knee, texture[near], index[near])
        return decrease

    def _by_table(self, at_knee: FloatArray, texture: FloatArray, index: IntArray) -> FloatArray:
        width = np.interp(np.sqrt(np.abs(texture)), TEXTURE_WIDTHS, np.arange(len(TEXTURE_WIDTHS)))
        lower = np.minimum(width.astype(np.int64), len(TEXTURE_WIDTHS) - 2)
        part = width - lower
        narrower, wider = (at_knee[index, each] for each in (lower, lower + 1))
        return np.asarray((narrower * (1 - part) + wider * part) * self.squared_grey[index] * texture)

    def _by_quadrature(self, texture: FloatArray, skewness: FloatArray, index: IntArray) -> FloatArray:
        """Return one Newton step from the mean by Taylor's theorem to that of two grey levels."""
        grey = self.grid[index]
        sigma, half = np.sqrt(np.abs(texture)), skewness / 2
        root = np.sqrt(1 + half**2)
        by_variance = np.clip(self.bend[index] * grey / 2 * sigma**2, -MAX_SHIFT, MAX_SHIFT)
        brighter, darker = (1 - by_variance + sigma * (half + side) for side in (root, -root))
        share = (1 - half / root) / 2
        mean = share * self._irradiance_at(grey * brighter) + (1 - share) * self._irradiance_at(grey * darker)
        excess = np.log(mean / self.irradiance[index])
        return np.asarray(np.sign(texture) * (grey * by_variance + excess / self.log_slope[index]))

    def _irradiance_at(self, grey: FloatArray) -> FloatArray:
        """Interpolate g linearly; numpy.interp, for any spacing of the grid, takes six times as long."""
        last = len(self.grid) - 1
        at = np.clip(grey, DARKEST_GREY, 1.0) * last
        lower = np.minimum(at.astype(np.int32), last - 1)
        below, above = self.irradiance.take(lower), self.irradiance.take(lower + 1)
        return np.asarray(below + (at - lower) * (above - below))

    @cached_property
    def squared_grey(self) -> FloatArray:
        """The squared grey level, limited from below."""
        return np.maximum(self.grid, DARKEST_GREY) ** 2

    @cached_property
    def distrust(self) -> FloatArray:
        """Divisor of the corrected share of the texture due to noise."""
        return 1 + (self.noise_variance / (MAX_NOISE**2 * self.squared_grey)) ** 2


@dataclass(frozen=True)
class ObservedShifts:
    """The shifts of observations, shape (n,) each; create them with :meth:`PixelMeans.at`."""

    means: PixelMeans
    observations: ExposedObservations
    index: IntArray

    @cached_property
    def _growth(self) -> FloatArray:
        """Growth of the noise with the gain of each observation."""
        return self.means.noise.growth(self.observations.log_exposure)

    def corrected(self, grey: FloatArray, texture_share: float) -> FloatArray:
        """Return grey levels of means of pixels, (n,), without the shift by noise and a share of that by texture."""
        by_texture = texture_share * self.means.by_texture(self.texture, self.observations.grey_skewness, self.index)
        return np.asarray(grey - self.increase_by_noise + by_texture)

    @property
    def increase_by_noise(self) -> FloatArray:
        """Increase of the mean by noise."""
        return np.asarray(self.means.by_noise[self.index] * self._growth)

    @property
    def variance_of_noise(self) -> FloatArray:
        """Variance of single pixels by noise."""
        return np.asarray(self.means.noise_variance[self.index] * self._growth)

    @property
    def texture(self) -> FloatArray:
        """Variance of the texture over the squared grey level, as far as it can be corrected; 0 if unknown."""
        texture = self._whole_texture
        limited = np.minimum(1, MAX_TEXTURE**2 / np.maximum(np.abs(texture), MAX_TEXTURE**2))
        # Equal for all observations of a point: a correction of only one would look like another exposure.
        share = self.observations.combined(np.minimum, limited / self.means.distrust[self.index])
        return np.asarray(texture * np.repeat(share, self.observations.counts))

    @property
    def error_variance(self) -> FloatArray:
        """Variance of the mean that a full correction of texture leaves."""
        counts = self.observations.counts
        mean = self.observations.combined(np.add, np.maximum(self._whole_texture, 0.0)) / counts
        return np.asarray(self.means.squared_grey[self.index] * (TEXTURE_ERROR * np.repeat(mean, counts)) ** 2)

    @cached_property
    def _whole_texture(self) -> FloatArray:
        """Variance of the texture over the squared grey level, however large and doubtful."""
        variance = self.observations.grey_variance
        texture = np.where(variance > 0, variance - self.variance_of_noise, 0.0)
        return np.asarray(texture / self.means.squared_grey[self.index])


def _decrease_at_knee(level: FloatArray, grid: FloatArray, log_response: FloatArray, mean: FloatArray) -> FloatArray:
    """Return the decrease of the mean by normally distributed texture over its variance, (n,) -> (n, widths)."""
    # ``mean`` is the mean of noisy pixels at each irradiance: noise and texture together are wider than either.
    coarse = np.linspace(max(level[0], DARKEST_GREY), level[-1], KNEE_LEVELS)
    irradiance = np.exp(np.interp(coarse, grid, log_response))[:, None, None]
    textured = irradiance * (1 + np.multiply.outer(TEXTURE_SPREADS, _NORMAL))
    grey = np.interp(np.log(np.maximum(textured, _TINY)), log_response, mean)
    variance = grey.var(axis=2)
    decrease = (np.interp(coarse, grid, mean)[:, None] - grey.mean(axis=2)) / np.maximum(variance, _TINY)
    width = np.sqrt(variance) / coarse[:, None]
    by_width = np.stack([np.interp(TEXTURE_WIDTHS, *each) for each in zip(width, decrease, strict=True)])
    return np.stack([np.interp(level, coarse, each) for each in by_width.T], axis=1)


def _around(mask: BoolArray, margin: int) -> BoolArray:
    """Return where a mask is true within a number of elements, shape (n,)."""
    so_far = np.pad(np.pad(np.cumsum(mask), (margin + 1, 0)), (0, margin), mode="edge")
    return np.asarray(so_far[2 * margin + 1 :] > so_far[: len(mask)])


def shift_and_variance(
    grid: FloatArray, log_response: FloatArray, noise: NoiseModel
) -> tuple[FloatArray, FloatArray]:
    """Return the shift of the mean of noisy pixels, and their variance, at grey levels with their ln g, (n,) each."""
    level = np.linspace(0, 1, SHIFT_LEVELS)
    log_g = np.interp(level, grid, log_response)
    irradiance = np.where(level > 0, np.exp(log_g), 0.0)
    constant, proportional, grey_variance = _parts_of_noise(level, irradiance, noise)
    sigma = np.sqrt(constant + proportional * irradiance)
    noisy = np.clip(irradiance[:, None] + sigma[:, None] * _NORMAL, 1e-12, 1.0)
    bent = np.interp(np.log(noisy), log_response, grid, left=0.0)
    # Noise of the grey level itself, from compression or quantisation, is clipped but not bent.
    mean = np.clip(bent.mean(axis=1)[:, None] + math.sqrt(grey_variance) * _NORMAL, 0.0, 1.0).mean(axis=1)
    # Below the lowest measured level, where the noise model repeats the nearest measurement, there is often more.
    variance, unmeasured = noise.variance(level), level < noise.measured[0]
    variance[unmeasured] = np.maximum(variance, bent.var(axis=1) + grey_variance)[unmeasured]
    return np.interp(grid, level, mean - level), np.interp(grid, level, variance)


def _parts_of_noise(level: FloatArray, irradiance: FloatArray, noise: NoiseModel) -> tuple[float, float, float]:
    """Return the variance of the irradiance at black, its growth with irradiance, and the variance of grey levels."""
    variance = noise.variance(level)
    slope = np.gradient(irradiance, level)
    # Near the ends, noise cannot be measured, and the noise model extends the nearest measurement.
    lowest, highest = noise.measured
    unclipped = np.minimum(level, 1 - level) > UNCLIPPED_SIGMAS * np.sqrt(variance)
    unclipped &= (level >= lowest) & (level <= highest)
    # Levels without any noise would have infinite weight.
    known = unclipped & (irradiance > MIN_NOISE_IRRADIANCE) & (variance > 0)
    if np.count_nonzero(known) < MIN_NOISE_LEVELS:
        return 0.0, 0.0, 0.0
    squared_slope = slope[known] ** 2
    of_irradiance = variance[known] * squared_slope
    # In blocks that all have some texture, its variance adds to that of noise; it grows with the squared grey level.
    parts = [np.ones(len(of_irradiance)), irradiance[known], squared_slope, squared_slope * level[known] ** 2]
    rows = np.stack(parts, axis=1) / of_irradiance[:, None]
    scale = rows.max(axis=0)
    constant, proportional, of_grey, _ = non_negative_least_squares(rows / scale, np.ones(len(rows))) / scale
    return float(constant), float(proportional), float(of_grey)
