"""Bends of piecewise linear functions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ospc.estimation.bends import sharpest_bend


@given(st.floats(1.0, 2.0), st.floats(-3, 3), st.floats(-3, 3))
def test_a_straight_line_has_no_bend_at_any_spacing_of_the_knots(exponent, start, slope):
    knots = np.linspace(0, 1, 12) ** exponent
    np.testing.assert_allclose(sharpest_bend(start + slope * knots, knots, np.linspace(0, 1, 50)), 0, atol=1e-10)


def test_a_kink_bends_its_surroundings_by_its_change_of_slope_times_the_spacing():
    knots = np.linspace(0, 1, 11)
    bend = sharpest_bend(2 * np.maximum(knots - 0.5, 0), knots, knots)
    np.testing.assert_allclose(bend, 0.2 * (np.abs(np.arange(11) - 5) <= 1), atol=1e-12)
