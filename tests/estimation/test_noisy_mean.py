"""The shift of a mean of noisy pixels against pixels that are drawn, bent by a response and clipped."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.estimation.noisy_mean import mean_shift
from ospc.photometry.noise import NoiseModel

GRID = np.linspace(0, 1, 4097)


def log_power(exponent):
    return exponent * np.log(np.maximum(GRID, 1e-5))


def noise_of(exponent, read, shot):
    """Return the noise in grey levels of a sensor with read and shot noise behind a power-law response."""
    grey = np.linspace(0, 1, 257)
    irradiance = np.maximum(grey, 1e-5) ** exponent
    slope = exponent * np.maximum(grey, 1e-5) ** (exponent - 1)
    return NoiseModel(0.0, 0.0, tuple((read + shot * irradiance) / slope**2))


@pytest.mark.parametrize(("exponent", "read", "shot"), [(1.0, 1e-4, 0.0), (1.0, 1e-5, 3e-4), (1.5, 4e-5, 1e-4)])
def test_the_shift_is_that_of_drawn_pixels(exponent, read, shot):
    found = mean_shift(GRID, log_power(exponent), noise_of(exponent, read, shot))
    grey = np.array([0.02, 0.05, 0.1, 0.3, 0.6, 0.9, 0.99, 1.0])
    irradiance = grey**exponent
    normal = np.random.default_rng(1).standard_normal((100_000, 1))
    # Each draw with its mirror image, which removes the largest part of the error of the mean.
    sigma = np.sqrt(read + shot * irradiance)
    pixels = [np.clip(irradiance + sign * normal * sigma, 0, 1) ** (1 / exponent) for sign in (-1, 1)]
    drawn = (pixels[0] + pixels[1]) / 2 - grey
    error = drawn.std(axis=0) / np.sqrt(len(drawn))
    largest = np.abs(drawn.mean(axis=0)).max()
    assert largest > 1e-3
    assert np.all(np.abs(np.interp(grey, GRID, found) - drawn.mean(axis=0)) < 5 * error + 0.05 * largest)


def test_clipping_raises_black_and_lowers_white():
    shift = mean_shift(GRID, log_power(1.0), NoiseModel(1e-4, 0.0))
    assert shift[0] == pytest.approx(0.01 / np.sqrt(2 * np.pi), rel=0.05)
    assert shift[-1] == pytest.approx(-0.01 / np.sqrt(2 * np.pi), rel=0.05)
    assert abs(shift[2048]) < 1e-6


def test_almost_no_noise_shifts_almost_nothing():
    np.testing.assert_allclose(mean_shift(GRID, log_power(2.2), NoiseModel(1e-12, 0.0)), 0, atol=1e-5)
