"""Numbers in messages."""

from __future__ import annotations

import math

import pytest

from ospc.errors import plain
from ospc.exposures.table import range_in_words


@pytest.mark.parametrize(
    ("number", "digits", "text"),
    [
        (32000.0, 3, "32000"),
        (12345678.0, 4, "12350000"),
        (1.30671e13, 6, "13067100000000"),
        (8.25, 2, "8.2"),
        (0.012345, 4, "0.01235"),
        (-40000.0, 1, "-40000"),
        (1e300, 4, "1e+300"),
        (1e-12, 4, "1e-12"),
        (math.inf, 4, "inf"),
        (math.nan, 4, "nan"),
    ],
)
def test_numbers_have_an_exponent_only_if_they_are_extreme(number: float, digits: int, text: str) -> None:
    assert plain(number, digits) == text


def test_ranges_of_long_exposures_have_no_exponent() -> None:
    assert range_in_words(0.5, 32000) == "0.5 to 32000 ms"
