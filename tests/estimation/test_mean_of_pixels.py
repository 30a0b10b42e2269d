"""The shift of the mean of noisy pixels, checked against simulated pixels and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr, ndtri
from scipy.stats import skew

from ospc.estimation.mean_of_pixels import PixelMeans, shift_and_variance
from ospc.estimation.response_basis import ResponseBasis
from ospc.exposures.table import ExposureTable
from ospc.observations import Observations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.settings.fit import MAX_SKEWNESS
from ospc.simulation.responses import RESPONSES

GRID = np.linspace(0, 1, 2041)
LINEAR = Response.gamma(1.0, 2041)
EXPOSURES = ExposureTable.of(np.zeros(2))
TABLE_LEVELS = 65
DRAWS, TABLE_DRAWS = 40_000, 8_000
"""Pixels drawn for each mean, and for each tabulated variance, whose 2 % error is a tenth of the tolerance."""


def log_response(response):
    return np.log(np.maximum(response.inverse(GRID), 1e-12))


def mean_shift(response, noise):
    return shift_and_variance(GRID, log_response(response), noise)[0]


def drawn(response, levels, full_well, read_noise, draws, grey_noise=0.0):
    """Return mean and variance of pixels with shot, read and grey-level noise, shape (levels,) each."""
    random = np.random.default_rng(7)
    electrons = full_well * response.inverse(levels)[:, None]
    counted = random.poisson(electrons, (len(levels), draws)) + random.normal(0, read_noise, (len(levels), draws))
    grey = response(np.clip(counted / full_well, 0, 1))
    if grey_noise:
        grey = np.clip(grey + random.normal(0, grey_noise, grey.shape), 0, 1)
    return grey.mean(axis=1), grey.var(axis=1)


@pytest.mark.parametrize(
    ("full_well", "read_noise", "grey_noise"), [(20_000, 5, 0.0), (3_000, 12, 0.0), (20_000, 5, 0.02)]
)
@pytest.mark.parametrize("name", sorted(set(RESPONSES) - {"tum_narrow"}))
def test_it_is_the_shift_of_pixels_drawn_one_by_one(name, full_well, read_noise, grey_noise):
    response, noise = RESPONSES[name](), (full_well, read_noise)
    _, variances = drawn(response, np.linspace(0, 1, TABLE_LEVELS), *noise, TABLE_DRAWS, grey_noise)
    levels = np.linspace(0.06, 0.97, 24)
    means, variance_of_draws = drawn(response, levels, *noise, DRAWS, grey_noise)
    shift = np.interp(levels, GRID, mean_shift(response, NoiseModel(0, 0, tuple(variances))))
    statistical = 4 * np.sqrt(variance_of_draws / DRAWS)
    true = means - levels
    np.testing.assert_array_less(np.abs(shift - true), statistical + 0.15 * np.abs(true) + 1e-5)


def test_noise_unmeasured_in_the_dark_is_extrapolated_from_brighter_levels():
    response, grid = Response.gamma(2.8, 2041), np.linspace(0, 1, TABLE_LEVELS)
    _, variances = drawn(response, grid, 3000, 12, TABLE_DRAWS)
    first = np.searchsorted(grid, 0.3)
    variances[:first] = variances[first]
    noise = NoiseModel(0, 0, tuple(variances), measured=(grid[first], 1.0))
    levels = np.linspace(0.18, 0.4, 6)
    means, drawn_variance = drawn(response, levels, 3000, 12, DRAWS)
    shift, variance = (
        np.interp(levels, GRID, found) for found in shift_and_variance(GRID, log_response(response), noise)
    )
    np.testing.assert_allclose(shift, means - levels, rtol=0.2, atol=2e-4)
    np.testing.assert_allclose(variance, drawn_variance, rtol=0.2)


def test_texture_in_every_block_does_not_hide_that_noise_comes_before_the_response():
    """With gamma near 2, shot noise is as constant in grey as noise of the grey level itself."""
    response, grid, contrast = Response.gamma(2.2, 2041), np.linspace(0, 1, TABLE_LEVELS), 0.015
    _, variances = drawn(response, grid, 10_000, 6, TABLE_DRAWS)
    textured = NoiseModel(0, 0, tuple(variances + (contrast * grid) ** 2), measured=(0.08, 0.8))
    levels = np.linspace(0.05, 0.2, 8)
    means, _ = drawn(response, levels, 10_000, 6, DRAWS)
    shift = np.interp(levels, GRID, mean_shift(response, textured))
    np.testing.assert_allclose(shift, means - levels, rtol=0.3, atol=2e-4)


@pytest.mark.parametrize("variance", [0.0, 1e-12])
def test_tiny_noise_causes_a_tiny_shift(variance):
    shift = mean_shift(Response.gamma(2.2, 2041), NoiseModel(variance, 0))
    np.testing.assert_allclose(shift, 0, atol=1e-6)


def test_levels_without_noise_do_not_hide_the_noise_of_the_others():
    variances = np.where(np.linspace(0, 1, TABLE_LEVELS) < 0.5, 0.0, 1e-4)
    shift = mean_shift(LINEAR, NoiseModel(0, 0, tuple(variances)))
    assert shift[-1] < -1e-3


@given(st.floats(0.005, 0.05))
def test_clipping_is_all_that_shifts_a_linear_response(sigma):
    shift = mean_shift(LINEAR, NoiseModel(sigma**2, 0))

    def mean_above(distance):
        """Return E[max(x, 0)] of a normal variable with mean ``distance``."""
        z = distance / sigma
        return sigma * (np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) + z * ndtr(z))

    expected = (mean_above(GRID) - GRID) - (mean_above(1 - GRID) - (1 - GRID))
    np.testing.assert_allclose(shift, expected, atol=0.02 * sigma)


@given(st.floats(1.2, 2.8), st.floats(0.002, 0.01))
def test_in_the_middle_it_is_half_the_curvature_times_the_variance(exponent, sigma):
    """Taylor: the mean of f(I + n) is f + f''σ²/2, here with constant noise σ of the irradiance."""

    def first(level):
        return level ** (1 - exponent) / exponent

    levels = np.maximum(np.linspace(0, 1, TABLE_LEVELS), 0.02)
    noise = NoiseModel(0, 0, tuple((first(levels) * sigma) ** 2))
    shift = mean_shift(Response.gamma(exponent, 2041), noise)
    second = first(0.5) * (1 / exponent - 1) / 0.5**exponent
    assert np.interp(0.5, GRID, shift) == pytest.approx(0.5 * second * sigma**2, rel=0.15, abs=3e-7)


@pytest.mark.parametrize("noise_sigma", [0.0, 0.001])
def test_the_mean_of_textured_and_noisy_pixels_at_a_knee_is_corrected(noise_sigma):
    """Compare the mean of simulated pixels with the grey level of their mean irradiance."""
    basis = ResponseBasis(32)
    coefficients = np.where(basis.knots <= 11 / 32, 1.0, 4.0)
    log_response = basis.log_of(coefficients)
    quantiles = ndtri((np.arange(999) + 0.5) / 999)

    def grey_at(irradiance):
        return np.interp(np.log(np.maximum(irradiance, 1e-9)), log_response, basis.grid)

    def noisy_at(irradiance):
        return grey_at(irradiance[..., None] + noise_sigma * quantiles)

    levels = np.linspace(0, 1, TABLE_LEVELS)
    variances = noisy_at(np.exp(np.interp(levels, basis.grid, log_response))).var(axis=1)
    means = PixelMeans.of(basis, coefficients, NoiseModel(0.0, 0.0, tuple(variances)))
    index = basis.index_of(np.linspace(0.28, 0.55, 15))
    irradiance = np.exp(log_response[index])[:, None] * (1 + 0.2 * quantiles)
    pixels = grey_at(irradiance)
    texture, skewness = pixels.var(axis=1) / basis.grid[index] ** 2, skew(pixels, axis=1)
    with_noise_alone = noisy_at(np.exp(log_response[index])).mean(axis=1)
    lowered = with_noise_alone - noisy_at(irradiance).mean(axis=(1, 2))
    assert lowered.max() > 0.012
    np.testing.assert_allclose(means.by_texture(texture, skewness, index), lowered, atol=0.0025)


def test_little_texture_counts_by_its_variance_however_skewed():
    basis = ResponseBasis(32)
    means = PixelMeans.of(basis, np.full(len(basis), 2.2), NoiseModel(0.0, 0.0, (0.0,)))
    index = basis.index_of(np.linspace(0.2, 0.9, 9))
    for skewness in (-1.0, 0.0, 1.0):
        once, negative = (means.by_texture(np.full(9, t), np.full(9, skewness), index) for t in (1e-4, -1e-4))
        np.testing.assert_allclose(once, 1e-4 * basis.grid[index] * 1.2 / 2, rtol=0.02)
        np.testing.assert_array_equal(negative, -once)


@pytest.mark.parametrize("gamma", [0.5, 1.6, 2.2])
@pytest.mark.parametrize("draw", ["lognormal", "two greys", "dark lines", "uniform"])
def test_the_mean_of_coarse_texture_is_corrected(gamma, draw):
    """Compare pixels of any distribution with the grey level of their mean irradiance."""
    random = np.random.default_rng(5)
    factors = {
        "lognormal": np.exp(0.5 * random.standard_normal(DRAWS)),
        "two greys": random.choice([0.5, 1.7], DRAWS),
        "dark lines": random.choice([0.25, 1.0], DRAWS, p=[0.15, 0.85]),
        "uniform": random.uniform(0.3, 1.7, DRAWS),
    }[draw]
    basis, grey = ResponseBasis(32), 0.2 * factors
    means = PixelMeans.of(basis, np.full(len(basis), gamma), NoiseModel(0.0, 0.0, (0.0,)))
    level = np.mean(grey**gamma) ** (1 / gamma)
    texture, third = np.array([grey.var()]) / level**2, np.array([skew(grey)])
    index = basis.index_of([level])
    decrease, unskewed = (float(means.by_texture(texture, of, index)[0]) for of in (third, 0 * third))
    assert decrease == pytest.approx(level - grey.mean(), abs=0.2 * abs(level - grey.mean()) + basis.grid[1])
    if abs(third[0]) > 1:
        assert abs(decrease - (level - grey.mean())) < abs(unskewed - (level - grey.mean()))


def test_skewness_of_pixels_that_vary_by_noise_alone_stays_bounded():
    basis = ResponseBasis(32)
    means = PixelMeans.of(basis, np.full(len(basis), 0.5), NoiseModel(0.0, 0.0, (1e-4,)))
    at = np.zeros((4, 2))
    seen = Observations.of_pairs(
        np.full(4, 0.2), np.full(4, 0.3), at, at, 0, 1,
        grey_variance0=[0.0, 5e-5, 1e-4, 1.001e-4], grey_third_moment0=[0.0, 1e-7, -1e-6, 1e-6],
    ).with_exposures(EXPOSURES)  # fmt: skip
    index = basis.index_of(seen.grey)
    shifts = means.at(seen, index)
    assert np.all(np.abs(seen.grey_skewness) <= MAX_SKEWNESS)
    assert np.all(np.abs(means.by_texture(shifts.texture, seen.grey_skewness, index)) < 1e-3)


@pytest.mark.parametrize("share", [0.002, 0.005, 0.01, 0.02])
@pytest.mark.parametrize("ratio", [1.25, 2.0])
def test_the_error_covers_clipped_lights_among_dark_pixels(share, ratio):
    """Compare two exposures of dark pixels of which some show lights, whose grey level cannot rise."""
    basis = ResponseBasis(32)
    coefficients = np.full(len(basis), 2.2)
    dark = np.array([0.01 * ratio**-0.5, 0.01 * ratio**0.5]) ** (1 / 2.2)
    grey = (1 - share) * dark + share
    variance = (1 - share) * dark**2 + share - grey**2
    third = (1 - share) * (dark - grey) ** 3 + share * (1 - grey) ** 3
    means = PixelMeans.of(basis, coefficients, NoiseModel(0.0, 0.0, (0.0,)))
    at = np.zeros((1, 2))
    seen = Observations.of_pairs(
        *grey[:, None], at, at, 0, 1,
        grey_variance0=variance[:1], grey_variance1=variance[1:],
        grey_third_moment0=third[:1], grey_third_moment1=third[1:],
    ).with_exposures(EXPOSURES)  # fmt: skip
    index = basis.index_of(seen.grey)
    shifts = means.at(seen, index)
    corrected = seen.grey + means.by_texture(shifts.texture, seen.grey_skewness, index)
    wrong = 2.2 * np.log(corrected[1] / corrected[0]) - np.log(ratio)
    sigma = 2.2 * np.sqrt(np.sum(shifts.error_variance / seen.grey**2))
    assert wrong < -0.2 * share
    assert -3 * sigma < wrong


def test_pixels_that_vary_no_more_than_their_noise_have_no_error_by_texture():
    basis = ResponseBasis(32)
    means = PixelMeans.of(basis, np.full(len(basis), 2.2), NoiseModel(0.0, 0.0, (1e-4,)))
    at = np.zeros((3, 2))
    variances = {"grey_variance0": [0.0, 5e-5, 9e-5], "grey_variance1": [1e-4, 2e-5, 0.0]}
    seen = Observations.of_pairs([0.1, 0.2, 0.4], [0.2, 0.3, 0.5], at, at, 0, 1, **variances)
    seen = seen.with_exposures(EXPOSURES)
    np.testing.assert_allclose(means.at(seen, basis.index_of(seen.grey)).error_variance, 0, atol=1e-15)


def test_gain_increases_shift_and_noise_alike():
    basis = ResponseBasis(32)
    noise = NoiseModel(1e-4, 0.0, gain_from_log_exposure=np.log(2.0), gain_power=1.5)
    means = PixelMeans.of(basis, np.full(len(basis), 2.2), noise)
    grey, at = np.array([0.3, 0.3]), np.zeros((2, 2))
    seen = Observations.of_pairs(grey, grey, at, at, 0, 1).with_exposures(ExposureTable.of(np.log([1.0, 8.0])))
    shifts = means.at(seen, basis.index_of(seen.grey))
    for increased in (shifts.increase_by_noise, shifts.variance_of_noise):
        np.testing.assert_allclose(increased[1::2] / increased[0::2], 4**1.5)
