"""Parsing of numbers in a line of text as in C and C++."""

from __future__ import annotations

import math
import re

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError

_DECIMAL = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_STREAM_NUMBER = re.compile(rf"[+-]?{_DECIMAL}", re.ASCII)
"""A decimal number as read by C++ streams, without NaN and infinity."""

_STREAM_NUMBERS = re.compile(rf"(?:\s*{_STREAM_NUMBER.pattern})*+", re.ASCII)

NUMBER = re.compile(rf"[+-]?(?:{_DECIMAL}|inf(?:inity)?|nan)", re.ASCII | re.IGNORECASE)
"""A number as read by C functions, including NaN and infinity."""

_SCANF_ITEM = {
    "d": re.compile(r"\s*([+-]?\d+)", re.ASCII),
    "f": re.compile(rf"\s*({NUMBER.pattern})", NUMBER.flags),
}


def words_of(line: str) -> list[str]:
    """Return the words of a line, separated by blanks, commas or semicolons."""
    return [word for word in re.split(r"[\s,;]+", line) if word]


def leading_numbers(line: str) -> tuple[FloatArray, str]:
    """Return the numbers at the beginning of a line, as extracted by C++ streams, and the remaining text.

    Extraction stops at a comma, ``nan``, ``inf``, and anything else that is not a decimal number.
    """
    found = _STREAM_NUMBERS.match(line)
    numbers = found.group() if found else ""
    return np.array([float(number) for number in _STREAM_NUMBER.findall(numbers)]), line[len(numbers) :].strip()


def scanned(line: str, conversions: str) -> list[float]:
    """Return the values that ``sscanf`` would convert up to the first failure; ``"dff"`` stands for ``"%d %lf %f"``.

    As in C, ``nan`` and ``inf`` are numbers, and ``d`` reads the leading integer of a number and leaves the rest for
    the next conversion.
    """
    values: list[float] = []
    position = 0
    for letter in conversions:
        match = _SCANF_ITEM[letter].match(line, position)
        if match is None:
            break
        values.append(float(match.group(1)))
        position = match.end()
    return values


def finite_number(text: str | None, name: str) -> float:
    """Return a number from a file; FormatError if it is missing (None) or not a finite number."""
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{name} is {'missing' if text is None else repr(text[:30])}, not a number")
    return value
