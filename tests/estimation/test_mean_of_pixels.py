"""The shift of a mean of noisy pixels: against pixels drawn one by one, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr, ndtri

from ospc.estimation.mean_of_pixels import PixelMeans, mean_shift
from ospc.estimation.response_basis import ResponseBasis
from ospc.observations import Observations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.settings.estimation import TEXTURE_CONTRASTS
from ospc.simulation.responses import RESPONSES

GRID = np.linspace(0, 1, 2041)
LINEAR = Response.gamma(1.0, 2041)
TABLE_LEVELS = 65
DRAWS, TABLE_DRAWS = 40_000, 8_000
"""Pixels whose mean is compared, and whose variance is found: two percent of it are a tenth of what may differ."""


def log_response(response):
    return np.log(np.maximum(response.inverse(GRID), 1e-12))


def drawn(response, levels, full_well, read_noise, draws):
    """Return mean and variance of pixels whose electrons are counted and read out, shape (levels,) each."""
    random = np.random.default_rng(7)
    electrons = full_well * response.inverse(levels)[:, None]
    counted = random.poisson(electrons, (len(levels), draws)) + random.normal(0, read_noise, (len(levels), draws))
    grey = response(np.clip(counted / full_well, 0, 1))
    return grey.mean(axis=1), grey.var(axis=1)


@pytest.mark.parametrize(("full_well", "read_noise"), [(20_000, 5), (3_000, 12)])
@pytest.mark.parametrize("name", sorted(set(RESPONSES) - {"tum_narrow"}))
def test_it_is_the_shift_of_pixels_drawn_one_by_one(name, full_well, read_noise):
    response = RESPONSES[name]()
    _, variances = drawn(response, np.linspace(0, 1, TABLE_LEVELS), full_well, read_noise, TABLE_DRAWS)
    levels = np.linspace(0.06, 0.97, 24)
    means, variance_of_draws = drawn(response, levels, full_well, read_noise, DRAWS)
    shift = np.interp(levels, GRID, mean_shift(GRID, log_response(response), NoiseModel(0, 0, tuple(variances))))
    statistical = 4 * np.sqrt(variance_of_draws / DRAWS)
    true = means - levels
    np.testing.assert_array_less(np.abs(shift - true), statistical + 0.15 * np.abs(true) + 1e-5)


@pytest.mark.parametrize("variance", [0.0, 1e-12])
def test_next_to_no_noise_shifts_next_to_nothing(variance):
    shift = mean_shift(GRID, log_response(Response.gamma(2.2, 2041)), NoiseModel(variance, 0))
    np.testing.assert_allclose(shift, 0, atol=1e-6)


def test_levels_without_noise_do_not_hide_the_noise_of_the_others():
    variances = np.where(np.linspace(0, 1, TABLE_LEVELS) < 0.5, 0.0, 1e-4)
    shift = mean_shift(GRID, log_response(LINEAR), NoiseModel(0, 0, tuple(variances)))
    assert shift[-1] < -1e-3


@given(st.floats(0.005, 0.05))
def test_clipping_is_all_that_shifts_a_linear_response(sigma):
    shift = mean_shift(GRID, log_response(LINEAR), NoiseModel(sigma**2, 0))

    def mean_above(distance):
        """Return E[max(x, 0)] of a normal variable whose mean is so far above zero."""
        z = distance / sigma
        return sigma * (np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) + z * ndtr(z))

    expected = (mean_above(GRID) - GRID) - (mean_above(1 - GRID) - (1 - GRID))
    np.testing.assert_allclose(shift, expected, atol=0.02 * sigma)


@given(st.floats(1.2, 2.8), st.floats(0.002, 0.01))
def test_in_the_middle_it_is_half_the_curvature_times_the_variance(exponent, sigma):
    """Taylor: the mean of f(I + n) is f + f''σ²/2, here for noise σ of the irradiance that is the same everywhere."""

    def first(level):
        return level ** (1 - exponent) / exponent

    levels = np.maximum(np.linspace(0, 1, TABLE_LEVELS), 0.02)
    noise = NoiseModel(0, 0, tuple((first(levels) * sigma) ** 2))
    shift = mean_shift(GRID, log_response(Response.gamma(exponent, 2041)), noise)
    second = first(0.5) * (1 / exponent - 1) / 0.5**exponent
    assert np.interp(0.5, GRID, shift) == pytest.approx(0.5 * second * sigma**2, rel=0.15, abs=3e-7)


NO_NOISE = NoiseModel(0.0, 0.0, (0.0,))
QUANTILES = ndtri((np.arange(999) + 0.5) / 999)
KNEE = np.where(np.arange(33) <= 11, 1.0, 4.0)


def textured(basis, coefficients, log_irradiance, contrast):
    """Return the grey levels of unevenly lit pixels, drawn one by one, with a mean irradiance, (n,) -> (n, 999)."""
    pixels = log_irradiance[:, None] + np.log1p(contrast * QUANTILES)
    return np.interp(pixels, basis.log_of(coefficients), basis.grid)


@pytest.mark.parametrize("coefficients", [KNEE, np.linspace(0.8, 3.0, 33)], ids=["knee", "bent"])
@pytest.mark.parametrize("contrast", [0.04, 0.1])
def test_texture_shifts_the_mean_as_pixels_drawn_one_by_one(coefficients, contrast):
    basis = ResponseBasis(32)
    means = PixelMeans.of(basis, coefficients, NO_NOISE)
    index = basis.index_of(np.linspace(0.15, 0.85, 57))
    pixels = textured(basis, coefficients, basis.log_of(coefficients)[index], contrast)
    seen = observed(pixels.mean(axis=1), pixels.var(axis=1))
    texture = means.texture(seen, np.repeat(index, 2))
    found = means.by_texture(texture.squared_contrast, texture.level, np.repeat(index, 2))[::2]
    true = pixels.mean(axis=1) - basis.grid[index]
    assert np.abs(found - true).max() < 0.3 * np.abs(true).max() + 1e-5
    np.testing.assert_allclose(np.sqrt(texture.squared_contrast[::2]), contrast, rtol=0.25)


@pytest.mark.parametrize("coefficients", [KNEE, np.linspace(0.8, 3.0, 33)], ids=["knee", "bent"])
def test_rows_are_the_derivatives_of_the_irradiance_that_explains_a_mean(coefficients):
    basis, contrast, step = ResponseBasis(32), 0.1, 0.01
    means = PixelMeans.of(basis, coefficients, NO_NOISE)
    index = basis.index_of(np.array([0.3, 0.34, 0.36, 0.5]))
    level = np.full(len(index), list(TEXTURE_CONTRASTS).index(contrast))
    rows = means.log_rows(basis)[means.row_of(level, index)]
    log_irradiance = basis.log_of(coefficients)[index]
    slope = means.grey_slope(level, index)
    for knot in (8, 10, 11, 13, 20):
        up, down = (coefficients + side * step * (np.arange(33) == knot) for side in (1, -1))
        change = textured(basis, up, log_irradiance, contrast) - textured(basis, down, log_irradiance, contrast)
        expected = -change.mean(axis=1) / (2 * step) / slope
        np.testing.assert_allclose(rows[:, knot], expected, rtol=0.1, atol=2e-3)


def test_without_texture_rows_are_those_of_the_response():
    basis = ResponseBasis(32)
    means = PixelMeans.of(basis, KNEE, NO_NOISE)
    index = basis.index_of(np.linspace(0.1, 0.9, 9))
    texture = means.texture(observed(basis.grid[index], np.zeros(9)), np.repeat(index, 2))
    np.testing.assert_array_equal(
        means.log_rows(basis)[means.row_of(texture.level, np.repeat(index, 2))][::2], basis.log_table[index]
    )
    np.testing.assert_array_equal(texture.squared_contrast, 0.0)


def observed(grey, variance):
    """Return observations of points that look the same in two frames, with a variance of their pixels."""
    place = np.zeros((len(grey), 2))
    return Observations.of_pairs(grey, grey, place, place, 0, 1, grey_variance0=variance, grey_variance1=variance)
