"""Numbers from outside, comparison of arrays by value, and counting of edges."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import timedelta
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from ospc.arrays import ByValue, count_reached, number_of, numbers_of
from ospc.correspondence.pixel_statistics import PixelReport
from ospc.exposures.lag_selection import LagEstimate
from ospc.observations import ExposedObservations, Observations
from ospc.photometry.calibration import Calibration
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette

VALUE_TYPES = (
    Calibration,
    Coverage,
    ExposedObservations,
    ExposureRatios,
    LagEstimate,
    Observations,
    PixelReport,
    RasterVignette,
    Response,
)


@dataclass(frozen=True, eq=False)
class Held(ByValue):
    value: Any
    name: str = field(default="", compare=False)


@pytest.mark.parametrize("kind", VALUE_TYPES)
def test_values_with_arrays_are_compared_by_value(kind):
    assert kind.__eq__ is ByValue.__eq__
    assert kind.__hash__ is ByValue.__hash__


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (np.arange(3), np.arange(3)),
        (np.array([np.nan, 0.0]), np.array([-np.nan, -0.0])),
        (float("nan"), float("nan")),
        ([1, (2.0, None)], (1, [2.0, None])),
        ({"a": np.zeros(2), "b": [1]}, {"b": [1], "a": np.zeros(2)}),
        (Held(np.ones(2)), Held(np.ones(2), "another name")),
    ],
)
def test_the_same_is_equal(one, other):
    assert Held(one) == Held(other)
    assert hash(Held(one)) == hash(Held(other))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (np.arange(3.0), np.nextafter(np.arange(3.0), 9)),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (np.zeros(2), None),
        ({"a": 1}, {"a": 2}),
        (1.0, float("nan")),
        (Held(np.ones(2)), np.ones(2)),
    ],
)
def test_what_differs_is_not_equal(one, other):
    assert Held(one) != Held(other)


@pytest.mark.parametrize("shape", [(0,), (40,), (5, 8)])
@pytest.mark.parametrize("edges", [[], [0.5], [0.0, 0.25, 0.25, 1.0]])
def test_reached_edges_are_counted_as_a_search_finds_them(edges, shape):
    values = np.random.default_rng(0).integers(-1, 6, shape) / 4  # many are equal to an edge
    found = count_reached(np.array(edges), values)
    assert np.array_equal(found, np.searchsorted(edges, values, side="right"))
    assert found.shape == shape


@pytest.mark.parametrize("value", [3, 3.0, True + 2, np.uint8(3), np.array(3.0), Fraction(3), Decimal(3)])
def test_numbers_of_any_type_are_numbers(value):
    assert number_of(value) == 3


@pytest.mark.parametrize(
    "value",
    [
        None,
        "3",
        b"3",
        3j,
        np.timedelta64(3, "ns"),
        np.datetime64(3, "ns"),
        timedelta(3),
        10**400,
        [3],
        np.array([3]),
        [],
        object(),
    ],
)
def test_what_is_no_number_or_has_a_unit_is_none(value):
    assert number_of(value) is None


def test_masked_numbers_are_nan_and_columns_of_texts_times_or_complex_numbers_are_none():
    masked = np.ma.masked_array([999, 2], [True, False])
    np.testing.assert_array_equal(numbers_of(masked), [np.nan, 2])
    for values in (
        ["3", "4"],
        [1, "2"],
        np.array([3, 4], "m8[ns]"),
        np.array([3, 4], "M8[s]"),
        [3j, 4],
        [[1], [2, 3]],
    ):
        assert numbers_of(values) is None
