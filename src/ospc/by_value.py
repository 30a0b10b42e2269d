"""Equality of values that hold arrays."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


class ByValue:
    """Base of dataclasses that hold arrays: they are equal if all their fields are, and NaN equals NaN.

    Declare them with ``eq=False``, because the generated comparison fails for arrays.
    """

    def __eq__(self, other: object) -> bool:
        """Return whether the other has the same class and equal fields."""
        return _content(self) == _content(other) if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        """Return a hash consistent with equality."""
        return hash(_content(self))


def _content(value: Any) -> Any:
    """Return a hashable stand-in that is equal for equal values."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f":
            value = np.where(np.isnan(value), np.nan, value) + 0.0  # NaN and zero have several forms each
        return value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), *(_content(getattr(value, field.name)) for field in fields(value) if field.compare)
    if isinstance(value, dict):
        return frozenset((key, _content(held)) for key, held in value.items())
    if isinstance(value, list | tuple):
        return tuple(map(_content, value))
    if isinstance(value, float) and math.isnan(value):
        return math.nan  # the same object is equal to itself within a tuple
    return value
