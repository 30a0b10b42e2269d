"""The table of a pcalib.txt: the inverse response on one line, as 32-bit floats from 0 to 255."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ospc.arrays import Float32Array, FloatArray
from ospc.formats.scanning import leading_numbers

FEWEST_VALUES = 256
"""DSO needs at least this many values, the monocular data set's tools exactly this many."""

MOST_VALUES = 65536
"""DSO has memory for this many values."""

_SMALLEST_POSITIVE = np.float32(1e-30)
"""Positive values stay above this; some parsers refuse subnormal numbers, which begin at 1.2e-38."""


@dataclass(frozen=True)
class PcalibText:
    """The text of a pcalib.txt, as the programs read it."""

    text: str

    @property
    def first_line(self) -> str:
        """The line that the programs read."""
        return self.text.split("\n", 1)[0]

    @property
    def other_lines(self) -> list[str]:
        """The lines after the first, without blank ones."""
        return [line.strip() for line in self.text.split("\n")[1:] if line.strip()]

    @cached_property
    def scanned(self) -> tuple[FloatArray, str]:
        """The numbers a program takes from the first line, shape (values,), and the text that stops it."""
        numbers, rest = leading_numbers(self.first_line)
        with np.errstate(over="ignore"):
            too_large = np.flatnonzero(~np.isfinite(numbers.astype(np.float32)))
        if too_large.size:  # a stream also stops at a number that its type cannot hold
            return numbers[: too_large[0]], f"{numbers[too_large[0]]:g}"
        return numbers, rest

    @property
    def values(self) -> Float32Array:
        """The table as the programs store it, shape (values,)."""
        return self.scanned[0].astype(np.float32)


def strictly_increasing_float32(values: npt.ArrayLike) -> Float32Array:
    """Return the curve nearest to one from 0 to 255 that increases strictly as 32-bit floats.

    Neighbours that 32 bits cannot tell apart move by as few representable steps as possible, in the least-squares
    sense; all other values, non-decreasing from 0 to 255, stay. Subnormal numbers are avoided: some parsers refuse
    them.
    """
    from scipy.optimize import isotonic_regression  # slow to import, and most commands write no table

    rounded = np.clip(np.asarray(values, dtype=np.float64), 0.0, 255.0).astype(np.float32)
    # Non-negative floats sort like the integers with the same bits, and neighbours stay neighbours.
    index = np.arange(rounded.size)
    slack = isotonic_regression(rounded.view(np.int32) - index).x
    least, most = _SMALLEST_POSITIVE.view(np.int32) - 1, np.float32(255).view(np.int32) - index[-1]
    spread = np.round(np.clip(slack, least, most)).astype(np.int32) + index
    spread[0], spread[-1] = 0, np.float32(255).view(np.int32)
    return np.asarray(spread.astype(np.int32).view(np.float32))


def table_text(values: npt.ArrayLike) -> str:
    """Return a non-decreasing curve as the text of a pcalib.txt: scaled to 0..255, with nine significant digits."""
    curve = np.asarray(values, dtype=np.float64)
    table = strictly_increasing_float32(255 * ((curve - curve[0]) / (curve[-1] - curve[0])))
    return " ".join(f"{value:.9g}" for value in table) + "\n"
