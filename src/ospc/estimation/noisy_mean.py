"""What noise does to a mean of grey values: it shifts it, wherever the response bends or ends.

A sensor adds its noise to the irradiance; the camera bends and clips what comes out. The mean of noisy pixels is then
not the grey level of the mean irradiance: near black, where responses are steep and noise reaches zero, the
difference is the largest error of all.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtri

from ospc.arrays import FloatArray
from ospc.photometry.noise import NoiseModel

_LEVELS = 513
_FEWEST = 4
_NORMAL = ndtri((np.arange(65) + 0.5) / 65)
"""Equally probable values of a standard normal variable."""


def mean_shift(grid: FloatArray, log_response: FloatArray, noise: NoiseModel) -> FloatArray:
    """Return the mean of noisy pixels minus the grey level without noise, at the grey levels of a grid, shape (n,).

    Parameters
    ----------
    grid
        Grey levels from 0 to 1, shape (n,).
    log_response
        ln g at them, increasing, shape (n,).
    noise
        Noise of single pixels, as variance of their grey level.
    """
    level = np.linspace(0, 1, _LEVELS)
    log_g = np.interp(level, grid, log_response)
    irradiance = np.where(level > 0, np.exp(log_g), 0.0)
    constant, proportional = _irradiance_noise(level, irradiance, noise)
    sigma = np.sqrt(constant + proportional * irradiance)
    noisy = np.clip(irradiance[:, None] + sigma[:, None] * _NORMAL, 1e-12, 1.0)
    mean = np.interp(np.log(noisy), log_response, grid, left=0.0).mean(axis=1)
    return np.asarray(np.interp(grid, level, mean - level))


def _irradiance_noise(level: FloatArray, irradiance: FloatArray, noise: NoiseModel) -> tuple[float, float]:
    """Return variance of the irradiance at black, and its growth with irradiance: read and shot noise."""
    variance = noise.variance(level)
    slope = np.gradient(irradiance, level)
    # Where noise reaches an end the gauge knows nothing, and repeats what it found nearest.
    # A gamma as steep as a step leaves next to nothing below it.
    known = (np.minimum(level, 1 - level) > 4 * np.sqrt(variance)) & (irradiance > 1e-9)
    if np.count_nonzero(known) < _FEWEST:
        return 0.0, 0.0
    of_irradiance = variance[known] * slope[known] ** 2
    rows = np.stack([np.ones(len(of_irradiance)), irradiance[known]], axis=1) / of_irradiance[:, None]
    constant, proportional = nnls(rows, np.ones(len(rows)))[0]
    return float(constant), float(proportional)
