"""Dataclasses stored by their declared types; values of other types are refused."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typing_extensions import TypeAliasType

from ospc.arrays import FloatArray, Image, IntArray
from ospc.errors import FormatError
from ospc.state import values
from ospc.state.values import layout, pack, unpack


@dataclass(frozen=True)
class Columns:
    grey: FloatArray
    frame: IntArray


@dataclass
class Part:
    _hidden: float = 0.0
    places: IntArray | None = None
    images: list[Image] = field(default_factory=list)


@dataclass(frozen=True)
class Whole:
    name: str
    yes: bool
    count: int
    span: tuple[float, float]
    many: tuple[float, ...]
    more: tuple[float, ...]
    nested: list[list[float]]
    choice: int | Literal["auto", "never"]
    part: Part | None
    columns: list[Columns]


NUMBERS = st.floats(allow_nan=False)
COLUMNS = st.integers(1, 4).map(lambda n: Columns(np.arange(n) / 3, np.arange(n)))
PARTS = st.builds(
    Part,
    NUMBERS,
    st.none() | st.just(np.arange(3)),
    st.lists(st.just(np.arange(4, dtype=np.uint8)), max_size=3),
)
WHOLES = st.builds(
    Whole,
    st.text(),
    st.booleans(),
    st.integers(-(2**53), 2**53),
    st.tuples(NUMBERS, NUMBERS),
    st.lists(NUMBERS, max_size=3).map(tuple),
    st.lists(NUMBERS, max_size=3).map(tuple),
    st.lists(st.lists(NUMBERS, max_size=2), max_size=3),
    st.integers(-9, 9) | st.sampled_from(["auto", "never"]),
    st.none() | PARTS,
    st.lists(COLUMNS, max_size=3),
)


def same(left, right):
    if isinstance(left, np.ndarray):
        return left.dtype == right.dtype and np.array_equal(left, right)
    if isinstance(left, list):
        return len(left) == len(right) and all(map(same, left, right))
    if hasattr(left, "__dataclass_fields__"):
        return type(left) is type(right) and all(
            same(getattr(left, f.name), getattr(right, f.name)) for f in fields(left)
        )
    return left == right


@given(WHOLES)
def test_what_is_packed_comes_out_the_same(whole):
    content, arrays = pack(whole)
    assert same(unpack(Whole, json.loads(json.dumps(content, allow_nan=False)), arrays, "it"), whole)


def test_numbers_that_json_has_no_word_for():
    content, arrays = pack(Part(math.inf))
    assert unpack(Part, content, arrays, "it")._hidden == math.inf


@pytest.mark.parametrize(
    "change",
    [
        {"_hidden": "much"},
        {"_hidden": True},
        {"_hidden": None},
        {"places": "nowhere"},
        {"places": 3},
        {"images": 3},
        {"images": {"name": "images", "lengths": [5, -1]}},
        {"images": {"name": "images", "lengths": [1]}},
        {"unknown": 1},
    ],
)
def test_what_does_not_fit_is_refused(change):
    content, arrays = pack(Part(1.0, np.arange(3), [np.zeros(4, np.uint8)]))
    with pytest.raises(FormatError, match=r"^it: .* is invalid"):
        unpack(Part, content | change, arrays, "it")


@pytest.mark.parametrize("name", [entry.name for entry in fields(Whole) if entry.name != "part"])
def test_null_is_refused_where_a_value_is_needed(name):
    content, arrays = pack(Whole("a", True, 1, (0.0, 1.0), (), (), [], "auto", None, []))
    with pytest.raises(FormatError, match=r"^it: .* is invalid"):
        unpack(Whole, content | {name: None}, arrays, "it")


@pytest.mark.parametrize("choice", ["always", "", 1.0, True, ["auto"], 2**70])
def test_what_is_none_of_several_types_is_refused(choice):
    content, arrays = pack(Whole("a", True, 1, (0.0, 1.0), (), (), [], "auto", None, []))
    with pytest.raises(FormatError, match=r"^it: .* is invalid"):
        unpack(Whole, content | {"choice": choice}, arrays, "it")


def test_an_array_of_another_type_is_refused():
    content, arrays = pack(Part(1.0, np.arange(3)))
    with pytest.raises(FormatError, match="type float64 instead of int64"):
        unpack(Part, content, arrays | {"places": np.zeros(3)}, "it")


def test_what_no_file_may_hold_is_refused():
    with pytest.raises(TypeError, match="_hidden of type object"):
        pack(Part(object()))  # type: ignore[arg-type]


def test_a_layout_distinguishes_classes_by_names_and_types():
    @dataclass
    class Other:
        _hidden: float
        places: IntArray | None
        images: list[Image]

    @dataclass
    class Renamed:
        hidden: float
        places: IntArray | None
        images: list[Image]

    assert layout(Other) == layout(Part)
    assert len({layout(Part), layout(Renamed), layout(Whole), layout(Columns)}) == 4


def test_arrays_are_known_by_the_name_that_newer_versions_of_numpy_give_them():
    number = TypeVar("number", bound=np.generic)
    named = TypeAliasType("named", np.ndarray[Any, np.dtype[number]], type_params=(number,))
    for alias in (named, npt.NDArray):
        assert values._described(alias[np.float64]) == "array of float64"
        assert values._described(alias[Any]) == "array of numbers"
