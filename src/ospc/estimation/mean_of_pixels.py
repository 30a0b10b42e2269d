"""How the mean of pixels differs from the grey level of their mean irradiance: by noise, and by texture.

A sensor adds noise to the irradiance; the response then bends and clips the sum. Near black, where responses are
steep and the noise is clipped, this shift of the mean is the largest error of all unless it is corrected.

Texture does the same. With a power law, the shift is alike for all exposures of a place. With other responses it is
not, and the fit would take it for a part of the response. So the irradiance of the pixels is modelled, too: it is
log-normal about its mean, and its contrast follows from the variance of their grey levels. A mean then depends on the
response at the grey levels of all its pixels, and so does its row of the linear system.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.response_basis import ResponseBasis
from ospc.least_squares import non_negative_least_squares
from ospc.observations import Observations
from ospc.photometry.noise import NoiseModel
from ospc.settings.estimation import (
    DARKEST_GREY,
    MAX_NOISE,
    MIN_NOISE_IRRADIANCE,
    MIN_NOISE_LEVELS,
    SHIFT_LEVELS,
    SHIFT_QUANTILES,
    TEXTURE_CONTRASTS,
    TEXTURE_GRID_STRIDE,
    TEXTURE_QUANTILES,
    UNCLIPPED_SIGMAS,
)


def _normal_values(count: int) -> FloatArray:
    """Return equally probable values of a standard normal variable, shape (count,)."""
    return np.array([NormalDist().inv_cdf((i + 0.5) / count) for i in range(count)])


_NORMAL = _normal_values(SHIFT_QUANTILES)
_TEXTURE = _normal_values(TEXTURE_QUANTILES) / _normal_values(TEXTURE_QUANTILES).std()
_CONTRASTS = np.array(TEXTURE_CONTRASTS)
_NEXT_CONTRAST = np.sqrt(_CONTRASTS[1:] * np.maximum(_CONTRASTS[:-1], _CONTRASTS[1] / 2))
"""From which contrast on the next of the tabulated ones stands for it."""


@dataclass(frozen=True)
class Texture:
    """How uneven the pixels are that n observations are means of, shape (n,) each.

    Attributes
    ----------
    squared_contrast
        Square of the standard deviation of their irradiance over its mean, as far as it counts as texture. Noise
        makes it negative where there is next to no texture.
    alike
        The mean of it over the observations of each point, if all variance beside noise counts as texture.
    level
        Index of the tabulated contrast that is nearest to the share of that which counts.
    """

    squared_contrast: FloatArray
    alike: FloatArray
    level: IntArray


@dataclass(frozen=True)
class PixelMeans:
    """The means of pixels under one response.

    Attributes
    ----------
    share
        Share of the variance beside noise that counts as texture.
    grid, log_slope
        The grid of the response's basis, and d ln g/dM on it, shape (grid,) each.
    by_noise
        What noise adds to the mean, shape (grid,).
    noise_variance
        Variance of single pixels, shape (grid,).
    places
        For each tabulated contrast of texture, and each stretch of the grid, where on it the pixels are whose mean
        irradiance has this grey level, shape (contrasts, stretches, quantiles).
    texture_shift
        What that texture adds to the mean, over its squared contrast, shape (contrasts, stretches). For no contrast
        it is that of the least one.
    """

    share: float
    grid: FloatArray
    log_slope: FloatArray
    by_noise: FloatArray
    noise_variance: FloatArray
    places: IntArray
    texture_shift: FloatArray

    @classmethod
    def of(cls, basis: ResponseBasis, coefficients: FloatArray, noise: NoiseModel, share: float = 1.0) -> PixelMeans:
        """Return the means under a response, by its coefficients, the noise of pixels and the share of texture."""
        log_response = basis.log_of(coefficients)
        slope = basis.gamma_of(coefficients) / np.maximum(basis.grid, DARKEST_GREY)
        relative = np.exp(_CONTRASTS[:, None] * _TEXTURE)
        log_relative = np.log(relative / relative.mean(axis=1, keepdims=True))
        pixels = log_response[::TEXTURE_GRID_STRIDE][None, :, None] + log_relative[:, None, :]
        # Places with saturated pixels are not observed, so pixels beyond white count as if the response went on.
        grey = np.interp(pixels, log_response, basis.grid) + np.maximum(pixels, 0.0) / slope[-1]
        squared = np.maximum(_CONTRASTS, _CONTRASTS[1])[:, None] ** 2
        shift = (grey.mean(axis=2) - basis.grid[::TEXTURE_GRID_STRIDE]) / squared
        shift[0] = shift[1]
        by_noise = mean_shift(basis.grid, log_response, noise)
        return cls(share, basis.grid, slope, by_noise, noise.variance(basis.grid), basis.index_of(grey), shift)

    def texture(self, observations: Observations, index: IntArray) -> Texture:
        """Return how uneven the pixels of observations are.

        ``index`` has the place of each observation's grey level in the grid, shape (n,).
        """
        variance = observations.grey_variance
        beside_noise = np.where(variance > 0, variance - self.noise_variance[index], 0.0)
        squared = beside_noise * self.log_slope[index] ** 2
        # At a knee the slope at the mean is not that of most pixels.
        squared = beside_noise / self.grey_slope(_level_of(self.share * squared), index) ** 2
        known = _CONTRASTS[-1] ** 2 / np.maximum(np.abs(squared), _CONTRASTS[-1] ** 2) / self._distrust[index]
        # The same of all observations of a point: what is corrected in one only would look like another exposure.
        squared = squared * np.repeat(observations.combined(np.minimum, known), observations.counts)
        alike = np.repeat(observations.combined(np.add, squared) / observations.counts, observations.counts)
        return Texture(self.share * squared, alike, _level_of(self.share * alike))

    def by_texture(self, squared_contrast: FloatArray, level: IntArray, index: IntArray) -> FloatArray:
        """Return what texture of a squared contrast adds to the mean, (n,), by the nearest contrast tabulated."""
        return np.asarray(self.texture_shift[level, index // TEXTURE_GRID_STRIDE] * squared_contrast)

    def grey_slope(self, level: IntArray, index: IntArray) -> FloatArray:
        """Return the derivative of the mean by ln of the mean irradiance, (n,)."""
        return np.where(level == 0, 1 / self.log_slope[index], self._grey_slope[level, index // TEXTURE_GRID_STRIDE])

    def log_rows(self, basis: ResponseBasis) -> FloatArray:
        """Return the derivatives of ln of the mean irradiance by coefficients of a basis, at a given mean.

        Its first rows are those of the grid, without texture; :meth:`row_of` says where the others are.
        """
        slope = self._pixel_slope
        weight = slope / slope.sum(axis=2, keepdims=True)
        rows = sum(weight[..., k, None] * basis.log_table[self.places[..., k]] for k in range(TEXTURE_QUANTILES))
        return np.concatenate([basis.log_table, np.reshape(rows, (-1, len(basis)))])

    def row_of(self, level: IntArray, index: IntArray) -> IntArray:
        """Return the row of :meth:`log_rows` for each observation, (n,)."""
        stretches = self.places.shape[1]
        textured = len(self.grid) + level * stretches + index // TEXTURE_GRID_STRIDE
        return np.asarray(np.where(level == 0, index, textured))

    @cached_property
    def _pixel_slope(self) -> FloatArray:
        """Slope dM/d ln g at the pixels, (contrasts, stretches, quantiles)."""
        return np.asarray(1 / self.log_slope[self.places])

    @cached_property
    def _grey_slope(self) -> FloatArray:
        return np.asarray(self._pixel_slope.mean(axis=2))

    @cached_property
    def _distrust(self) -> FloatArray:
        """By how much noise reduces the share of the texture that is taken out, on the grid."""
        return 1 + (self.noise_variance / (MAX_NOISE * np.maximum(self.grid, DARKEST_GREY)) ** 2) ** 2


def _level_of(squared_contrast: FloatArray) -> IntArray:
    """Return the index of the tabulated contrast nearest to others, (n,)."""
    return np.asarray(np.searchsorted(_NEXT_CONTRAST, np.sqrt(np.maximum(squared_contrast, 0.0))))


def mean_shift(grid: FloatArray, log_response: FloatArray, noise: NoiseModel) -> FloatArray:
    """Return the mean of noisy pixels minus the noise-free grey level, at grey levels with their ln g, shape (n,)."""
    level = np.linspace(0, 1, SHIFT_LEVELS)
    log_g = np.interp(level, grid, log_response)
    irradiance = np.where(level > 0, np.exp(log_g), 0.0)
    constant, proportional = _irradiance_noise(level, irradiance, noise)
    sigma = np.sqrt(constant + proportional * irradiance)
    noisy = np.clip(irradiance[:, None] + sigma[:, None] * _NORMAL, 1e-12, 1.0)
    mean = np.interp(np.log(noisy), log_response, grid, left=0.0).mean(axis=1)
    return np.asarray(np.interp(grid, level, mean - level))


def _irradiance_noise(level: FloatArray, irradiance: FloatArray, noise: NoiseModel) -> tuple[float, float]:
    """Return the variance of the irradiance at black and its growth with irradiance: read and shot noise."""
    variance = noise.variance(level)
    slope = np.gradient(irradiance, level)
    # Near the ends, noise cannot be measured, and the model repeats the nearest measurement.
    unclipped = np.minimum(level, 1 - level) > UNCLIPPED_SIGMAS * np.sqrt(variance)
    # Levels without any noise would have infinite weight.
    known = unclipped & (irradiance > MIN_NOISE_IRRADIANCE) & (variance > 0)
    if np.count_nonzero(known) < MIN_NOISE_LEVELS:
        return 0.0, 0.0
    of_irradiance = variance[known] * slope[known] ** 2
    rows = np.stack([np.ones(len(of_irradiance)), irradiance[known]], axis=1) / of_irradiance[:, None]
    constant, proportional = non_negative_least_squares(rows, np.ones(len(rows)))
    return float(constant), float(proportional)
