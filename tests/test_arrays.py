"""Objects that contain arrays are compared by value, and few edges are counted as a search finds them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from ospc.arrays import ByValue, count_reached
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
