"""Metrics: zero at the truth, invariant under unobservable changes, and equal to their written-out definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from log_polynomials import log_polynomial
from ospc.errors import FormatError
from ospc.evaluation.metrics import (
    coverage,
    log_ratio_error,
    response_rmse,
    response_shape_rmse,
    vignette_pixel_rmse,
    vignette_rmse,
)
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, RasterVignette

exponents = st.floats(0.5, 3.0)


@given(exponents)
def test_response_errors_vanish_at_the_truth(exponent):
    response = Response.gamma(exponent)
    assert response_rmse(response, response) == 0
    assert response_shape_rmse(response, response) < 1e-15
    assert log_ratio_error(response, response) == 0


@given(exponents, exponents)
def test_response_rmse_is_its_definition(a, b):
    total = sum(((i / 255) ** a - (i / 255) ** b) ** 2 for i in range(256))
    assert response_rmse(Response.gamma(a), Response.gamma(b)) == pytest.approx(math.sqrt(total / 256), abs=1e-12)


@given(exponents, exponents)
def test_shape_error_is_that_of_the_best_scale(a, b):
    g, truth = (np.linspace(0, 1, 256)[5:251] ** e for e in (a, b))
    measured = response_shape_rmse(Response.gamma(a), Response.gamma(b))
    scale = np.linalg.lstsq(g[:, None], truth, rcond=None)[0][0]
    for other in (scale, scale * 1.01, scale * 0.99):
        assert measured <= np.sqrt(np.mean((other * g - truth) ** 2)) + 1e-12
    assert measured == pytest.approx(np.sqrt(np.mean((scale * g - truth) ** 2)), abs=1e-12)


def test_shape_and_ratios_ignore_an_end_that_only_changes_the_scale():
    truth = Response.gamma(2.0)
    table = np.array(truth.inverse_table)
    table[:252] *= 0.8
    bent = Response(table)
    assert response_rmse(bent, truth) > 0.05
    assert response_shape_rmse(bent, truth) < 1e-12
    assert log_ratio_error(bent, truth) < 1e-12


@given(exponents, exponents)
def test_log_ratio_error_of_powers_is_known(a, b):
    # ln g(a)/g(b) = γ ln(a/b), and the median of |ln b/a| is 0.6745·0.3 apart from the clipping
    kappa = log_ratio_error(Response.gamma(a), Response.gamma(b))
    assert kappa == pytest.approx(abs(a - b) * 0.6745 * 0.3, rel=0.12, abs=2e-4)


def test_log_ratio_error_depends_on_its_seed_little_and_repeats():
    a, b = Response.gamma(1.8), Response.gamma(2.2)
    assert log_ratio_error(a, b, seed=3) == log_ratio_error(a, b, seed=3)
    assert log_ratio_error(a, b, seed=3) == pytest.approx(log_ratio_error(a, b, seed=4), rel=0.05)


def test_tables_of_more_levels_are_compared_at_256():
    assert response_rmse(Response.gamma(2.0, 65536), Response.gamma(2.0)) < 1e-4


def test_vignette_error_of_a_known_difference():
    size = (320, 240)
    flat = PolynomialVignette(size, (0.0, 0.0, 0.0))
    fall = PolynomialVignette(size, (-0.4, 0.0, 0.0))
    middles = (np.arange(50) + 0.5) / 50
    expected = np.sqrt(np.mean((0.4 * middles**2) ** 2))
    assert vignette_rmse(fall, flat) == pytest.approx(expected, rel=0.02)
    assert vignette_rmse(fall, fall) == 0
    assert vignette_pixel_rmse(fall, fall) == 0


@pytest.mark.parametrize("size", [(64, 48), (10, 8), (2, 2)])
def test_vignette_scale_is_not_observable(size):
    values = PolynomialVignette(size, (-0.4, 0.1, 0.0)).image()
    a, b = RasterVignette(values), RasterVignette(values * 0.37)
    assert vignette_rmse(a, b) < 1e-6
    assert vignette_pixel_rmse(a, b) < 1e-6


def test_non_radial_errors_show_in_pixels_but_not_in_the_profile():
    radial = log_polynomial((160, 120), (-0.3,))
    skew = log_polynomial((160, 120), (-0.3,), non_radial=(0.0, 0.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert vignette_rmse(skew, radial) < 0.02
    assert vignette_pixel_rmse(skew, radial) > 0.03


def test_profiles_of_different_sizes_compare_and_pixels_do_not():
    a, b = (PolynomialVignette(size, (-0.3, 0.05, 0.0)) for size in ((320, 240), (640, 480)))
    assert vignette_rmse(a, b) < 0.005
    with pytest.raises(FormatError, match="320x240 and 640x480"):
        vignette_pixel_rmse(a, b)


def test_pixel_error_is_its_definition():
    rng = np.random.default_rng(0)
    values = [rng.uniform(0.5, 1, (24, 32)).astype(np.float32) for _ in range(2)]
    y, x = np.mgrid[:24, :32]
    centre = np.hypot(x - 15.5, y - 11.5) / np.hypot(15.5, 11.5) < 0.06
    relative = [v / v[centre].mean() for v in values]
    expected = np.sqrt(np.mean((relative[0] - relative[1]) ** 2))
    assert vignette_pixel_rmse(RasterVignette(values[0]), RasterVignette(values[1])) == pytest.approx(expected, 1e-5)


def test_coverage_of_honest_deviations():
    rng = np.random.default_rng(0)
    truth = np.linspace(0, 1, 51)
    sigma = np.broadcast_to(np.linspace(0.01, 0.05, 51), (2000, 51))
    share = coverage(truth + sigma * rng.normal(size=sigma.shape), sigma, truth)
    assert share == pytest.approx((0.683, 0.954), abs=0.005)


def test_coverage_skips_what_is_fixed_and_counts_false_certainty():
    assert coverage([0.0, 0.5, 1.0], [0.0, 0.1, 0.0], [0.0, 0.55, 1.0]) == (1.0, 1.0)
    assert coverage([0.0, 0.5, 0.9], [0.0, 0.1, 0.0], [0.0, 0.65, 1.0]) == (0.0, 0.5)
    for estimate, sigma in (([0.0], [0.0]), ([0.0], [-1.0]), ([np.nan], [1.0])):
        with pytest.raises(FormatError):
            coverage(estimate, sigma, [0.0])
