"""Responses: f and g are inverse to each other, strictly increasing, and correct at both ends."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.errors import FormatError, SettingError
from ospc.photometry.response import Response

steps = st.lists(st.floats(0.01, 1.0), min_size=1, max_size=60)
unit = st.floats(0.0, 1.0)
exponents = st.floats(0.3, 4.0)


def of_steps(increments):
    return Response.from_values(np.concatenate([[0.0], np.cumsum(increments)]))


@given(steps, unit)
def test_forward_and_inverse_undo_each_other(increments, value):
    response = of_steps(increments)
    assert response(response.inverse(value)) == pytest.approx(value, abs=1e-9)
    assert response.inverse(response(value)) == pytest.approx(value, abs=1e-9)


@given(steps, st.lists(unit, min_size=2, max_size=20, unique=True))
def test_both_directions_rise_and_keep_the_ends(increments, values):
    response = of_steps(increments)
    ordered = np.sort(values)
    apart = np.diff(ordered) > 1e-9
    assert np.all(np.diff(response(ordered))[apart] > 0)
    assert np.all(np.diff(response.inverse(ordered))[apart] > 0)
    np.testing.assert_array_equal(response([0.0, 1.0]), [0.0, 1.0])
    np.testing.assert_array_equal(response.inverse([0.0, 1.0]), [0.0, 1.0])


@given(steps, st.floats(1.0, 10.0))
def test_what_is_outside_is_clipped(increments, beyond):
    response = of_steps(increments)
    np.testing.assert_array_equal(response([-beyond, 1 + beyond]), [0.0, 1.0])
    np.testing.assert_array_equal(response.inverse([-beyond, 1 + beyond]), [0.0, 1.0])


@given(steps, st.floats(1e-3, 1e3), st.floats(-10.0, 10.0))
def test_scale_and_shift_of_the_values_do_not_matter(increments, scale, shift):
    plain = of_steps(increments)
    values = np.concatenate([[0.0], np.cumsum(increments)])
    moved = Response.from_values(values * scale + shift)
    np.testing.assert_allclose(moved.inverse_table, plain.inverse_table, rtol=0, atol=1e-9)


@given(exponents, st.floats(1e-3, 1.0))
def test_gamma_is_a_power_at_its_levels_and_its_root_forwards(exponent, value):
    response = Response.gamma(exponent, 1025)
    np.testing.assert_allclose(response.inverse_table, response.levels**exponent, atol=1e-15)
    # Between levels the table is linear; its largest error is at black and smaller than one step.
    assert response(value) == pytest.approx(value ** (1 / exponent), abs=1 / 1024)


@given(steps)
def test_resampling_at_finer_nested_levels_and_back_changes_nothing(increments):
    response = of_steps(increments)
    n = response.inverse_table.size
    np.testing.assert_allclose(response.resampled(n), response.inverse_table, atol=1e-15)
    fine = Response(response.resampled(4 * (n - 1) + 1))
    np.testing.assert_allclose(fine.resampled(n), response.inverse_table, atol=1e-12)
    values = np.linspace(0, 1, 97)
    np.testing.assert_allclose(fine.inverse(values), response.inverse(values), atol=1e-12)


def test_shapes_are_kept():
    response = Response.gamma(2.0)
    for shape in ((), (3,), (2, 3)):
        assert response(np.full(shape, 0.5)).shape == shape
        assert response.inverse(np.full(shape, 0.5)).shape == shape


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ([0.0, 0.5, 0.5, 1.0], "strictly.*level 1"),
        ([0.0, 0.6, 0.5, 1.0], "strictly.*level 1"),
        ([1.0, 0.5, 0.0], "strictly"),
        ([0.0, np.nan, 1.0], "finite"),
        ([0.0, 0.5, np.inf], "finite"),
        ([0.1, 0.5, 1.0], "begin at 0"),
        ([0.0, 0.5, 0.9], "end at 1"),
        ([0.0], "at least 2"),
        ([[0.0, 0.5], [0.6, 1.0]], "one dimension"),
    ],
)
def test_what_is_no_inverse_response_is_refused(table, complaint):
    with pytest.raises(FormatError, match=complaint):
        Response(np.array(table))


@pytest.mark.parametrize("values", [[3.0, 2.0, 1.0], [1.0, 1.0, 1.0], [0.0, np.nan, 1.0], [0.0, 2.0, 1.0], [5.0], []])
def test_values_that_cannot_be_normalised_are_refused(values):
    with pytest.raises(FormatError):
        Response.from_values(values)


@pytest.mark.parametrize("support", [(0.9, 0.1), (-0.1, 1.0), (0.0, 1.1), (0.1, np.nan)])
def test_an_impossible_measured_range_is_refused(support):
    with pytest.raises(FormatError, match="support is"):
        Response(np.linspace(0, 1, 5), support=support)


def test_deviations_have_the_shape_of_the_table():
    with pytest.raises(FormatError, match="log_sigma"):
        Response(np.linspace(0, 1, 5), log_sigma=np.zeros((5, 1)))


def test_a_response_is_a_value_that_nobody_can_change():
    source = np.linspace(0, 1, 5)
    response = Response(source, log_sigma=source)
    source[2] = 0.7
    assert response.inverse_table[2] == 0.5
    for array in (response.inverse_table, response.log_sigma):
        with pytest.raises(ValueError, match="read-only"):
            array[1] = 0.3


@given(st.floats(0.3, 3.0), st.floats(0.05, 0.95))
def test_a_curve_in_another_scale_is_matched_exactly(exponent, reference):
    response = replace(Response.gamma(exponent), support=(reference, reference))
    # The same shape, as seen by a camera that saturates later.
    other = Response.from_values(np.append(0.8 * response.inverse_table[:-1], 1.0))
    np.testing.assert_allclose(response.matched(other)[1:-1], response.inverse_table[1:-1], rtol=1e-9)


def test_the_band_is_that_of_the_shape_in_units_of_irradiance():
    response = Response(np.linspace(0, 1, 5), log_sigma=np.full(5, 0.1), scale_sigma=7.0)
    np.testing.assert_allclose(response.inverse_sigma, 0.1 * np.linspace(0, 1, 5))


@pytest.mark.parametrize("grey", [200, np.uint8(200), np.full((2, 3), 200, np.uint8)])
def test_grey_values_in_place_of_grey_levels_are_refused(grey):
    with pytest.raises(SettingError, match="divide grey values by the largest possible value"):
        Response.gamma(2.2).inverse(grey)
    assert Response.gamma(2.2).inverse([0, 1]).tolist() == [0, 1]
    assert Response.gamma(2.2).inverse([]).size == 0


@pytest.mark.parametrize("exponent", [0, -1, math.inf, math.nan, "steep"])
def test_an_exponent_must_be_a_positive_number(exponent):
    with pytest.raises(SettingError, match="give a positive number"):
        Response.gamma(exponent)


@pytest.mark.parametrize("exponent", [300, 1e-17])
def test_values_of_a_power_must_differ(exponent):
    with pytest.raises(SettingError, match="all 256 values differ"):
        Response.gamma(exponent)
