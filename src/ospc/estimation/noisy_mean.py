"""The shift of the mean of noisy grey values where the response is curved or clips.

A sensor adds noise to the irradiance; the response then bends and clips the sum. The mean of noisy pixels is
therefore not the grey level of the mean irradiance. Near black, where responses are steep and the noise is clipped,
this is the largest error of all unless it is corrected.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtri

from ospc.arrays import FloatArray
from ospc.photometry.noise import NoiseModel
from ospc.settings.estimation import (
    MIN_NOISE_IRRADIANCE,
    MIN_NOISE_LEVELS,
    SHIFT_LEVELS,
    SHIFT_QUANTILES,
    UNCLIPPED_SIGMAS,
)

_NORMAL = ndtri((np.arange(SHIFT_QUANTILES) + 0.5) / SHIFT_QUANTILES)
"""Equally probable values of a standard normal variable, shape (65,)."""


def mean_shift(grid: FloatArray, log_response: FloatArray, noise: NoiseModel) -> FloatArray:
    """Return the mean of noisy pixels minus the noise-free grey level, at each grey level of a grid, shape (n,).

    Parameters
    ----------
    grid
        Grey levels from 0 to 1, shape (n,).
    log_response
        ln g at them, increasing, shape (n,).
    noise
        Noise of single pixels.
    """
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
    constant, proportional = nnls(rows, np.ones(len(rows)))[0]
    return float(constant), float(proportional)
