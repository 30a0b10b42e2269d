"""Splines in R² checked against SciPy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline, make_interp_spline

from ospc.photometry.radial_spline import RadialSpline

splines = st.builds(RadialSpline, st.integers(2, 20), st.floats(0.1, 2.0))
seeds = st.integers(0, 2**32 - 1)


@given(splines, seeds)
def test_values_are_the_integral_of_a_piecewise_linear_slope(spline, seed):
    random = np.random.default_rng(seed)
    slopes = random.normal(0, 1, spline.terms)
    within = random.uniform(0, spline.knots[-1], 30)
    slope: BSpline = make_interp_spline(spline.knots, slopes, k=1)
    integral = slope.antiderivative()
    np.testing.assert_allclose(spline.slope(slopes, within), slope(within), atol=1e-9)
    np.testing.assert_allclose(spline.values(slopes, within), integral(within) - integral(0.0), atol=1e-9)
    beyond = spline.knots[-1] + random.uniform(0, 1, 5)
    straight = integral(spline.knots[-1]) - integral(0.0) + slopes[-1] * (beyond - spline.knots[-1])
    np.testing.assert_allclose(spline.values(slopes, beyond), straight, atol=1e-9)


@given(st.integers(0, 20), st.floats(0.1, 2.0), seeds)
def test_values_and_slopes_are_linear_in_the_slopes_at_the_knots(terms, reach, seed):
    spline = RadialSpline(terms, reach)
    random = np.random.default_rng(seed)
    slopes, squared = random.normal(0, 1, terms), random.uniform(0, 1.5 * reach**2, 30)
    np.testing.assert_allclose(spline.jacobian(squared) @ slopes, spline.values(slopes, squared), atol=1e-12)
    np.testing.assert_allclose(spline.slopes_at(squared) @ slopes, spline.slope(slopes, squared), atol=1e-12)
    assert spline.values(slopes, np.zeros((2, 3))).tolist() == np.zeros((2, 3)).tolist()
