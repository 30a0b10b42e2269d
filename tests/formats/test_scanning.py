"""Numbers are parsed from text as in C and C++."""

from __future__ import annotations

import ctypes
import ctypes.util

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.formats.scanning import leading_numbers, scanned


def test_leading_numbers_stop_where_a_stream_does():
    values, rest = leading_numbers(" 1 -2.5\t.5 3. 1e2 +4 inf 6")
    np.testing.assert_array_equal(values, [1, -2.5, 0.5, 3, 100, 4])
    assert rest == "inf 6"


@pytest.mark.parametrize(
    ("line", "values"),
    [
        ("0 1.5 2.5", [0, 1.5, 2.5]),
        ("  00017\t1e3 .5 7 8", [17, 1000, 0.5]),
        ("0 1.5", [0, 1.5]),
        ("1520531829251142058 1.5 2", [1520531829251142058.0, 1.5, 2]),
        ("1463163683.5864 3.5", [1463163683, 0.5864, 3.5]),
        ("00001.png 1.5 2.5", [1]),
        ("a.png 1.5 2.5", []),
        ("# id stamp", []),
        ("1,2,3", [1]),
        ("", []),
    ],
)
def test_scanned_lines_are_torn_as_sscanf_tears_them(line, values):
    assert scanned(line, "dff") == values


def test_scanned_takes_what_is_no_number():
    values = scanned("3 inf nan", "dff")
    assert values[:2] == [3, np.inf]
    assert np.isnan(values[2])


def by_the_c_library(line: str) -> list[float]:
    name = ctypes.util.find_library("c")
    if name is None:
        pytest.skip("no C library to compare with")
    number, stamp, exposure = ctypes.c_int(), ctypes.c_double(), ctypes.c_float()
    count = ctypes.CDLL(name).sscanf(
        line.encode(), b"%d %lf %f", ctypes.byref(number), ctypes.byref(stamp), ctypes.byref(exposure)
    )
    return [number.value, stamp.value, exposure.value][: max(count, 0)]


@settings(max_examples=100, deadline=None)
@given(st.text(alphabet="0123456789.-+ \t,#a", max_size=24))
def test_scanned_agrees_with_the_c_library(line):
    expected, actual = by_the_c_library(line), scanned(line, "dff")
    assert len(actual) == len(expected)
    if actual and abs(actual[0]) < 2**31:
        np.testing.assert_allclose(actual, np.array(expected), rtol=1e-6)
