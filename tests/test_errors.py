"""Numbers in messages."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ospc
from ospc.errors import OspcError, plain
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


OBSERVED = ospc.Observations.of_pairs(*np.full((2, 30), 0.5), *np.zeros((2, 30, 2)), 0, 1)
CALLS: dict[str, Callable[[Any], object]] = {
    "calibrate": ospc.calibrate,
    "open_recording": ospc.open_recording,
    "kind": lambda wrong: ospc.open_recording(Path(__file__).parent, wrong),
    "options": lambda wrong: ospc.open_recording(Path(__file__).parent, options=wrong),
    "observations": lambda wrong: ospc.fit(wrong, np.ones(2)),
    "exposures": lambda wrong: ospc.fit(OBSERVED, wrong),
    "noise": lambda wrong: ospc.fit(OBSERVED, np.ones(2), noise=wrong),
    "positions": lambda wrong: ospc.Observations.of_pairs([0.5], [0.5], wrong, [0, 0], 0, 1),
    "load": ospc.Calibration.load,
    "save": ospc.Calibration((12, 8)).save,
    "max_grey": lambda wrong: ospc.Calibration((12, 8)).saturated(np.zeros((8, 12), np.uint8), max_grey=wrong),
    "state": ospc.OnlineCalibrator.load_state,
    "simulate": ospc.simulate,
    "response": ospc.Response,
    "values": ospc.Response.from_values,
    "exponent": ospc.Response.gamma,
}


@pytest.mark.parametrize("wrong", [object(), {}, ["a"]], ids=["object", "dict", "texts"])
@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_values_of_wrong_types_are_errors_of_the_library(call: Callable[[Any], object], wrong: object) -> None:
    with pytest.raises(OspcError):
        call(wrong)


@pytest.mark.parametrize("call", [ospc.calibrate, ospc.open_recording, ospc.Calibration.load])
def test_neither_nothing_nor_a_number_is_a_path(call: Callable[[Any], object]) -> None:
    for wrong in (None, 5):
        with pytest.raises(OspcError, match=type(wrong).__name__):
            call(wrong)
