"""The lines of a times.txt, as the programs read them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ospc.arrays import FloatArray
from ospc.formats.scanning import scanned

LONGEST_LINE = 999
"""Characters that fit the line buffers of the programs."""

_WORD = re.compile(r"\S+", re.ASCII)


class Row(NamedTuple):
    """The words of one line, and the number of the line, from 1."""

    number: int
    words: list[str]


@dataclass(frozen=True)
class TimesText:
    """The text of a times.txt, as the programs read it."""

    text: str

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """The words of every line, without comments and blank lines."""
        lines = enumerate(self.text.split("\n"), start=1)
        split = (Row(number, _WORD.findall(line)) for number, line in lines)
        return tuple(row for row in split if row.words and not row.words[0].startswith("#"))

    @cached_property
    def scanned(self) -> FloatArray:
        """Ids, stamps in s and exposures in ms as DSO takes them, shape (lines, 3); a missing exposure is 0."""
        values: list[list[float]] = []
        for line in self.text.split("\n"):
            if len(line) > LONGEST_LINE:
                break
            row = scanned(line, "dff")
            if len(row) >= 2:
                values.append([*row, 0.0][:3])
        return np.array(values, dtype=np.float64).reshape(-1, 3)

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposures as DSO stores them, in 32 bits, shape (lines,)."""
        with np.errstate(over="ignore", under="ignore"):
            return self.scanned[:, 2].astype(np.float32).astype(np.float64)

    def with_rows(self, rows: list[list[str]]) -> TimesText:
        """Return a text with other lines."""
        return TimesText("".join(" ".join(words) + "\n" for words in rows))


def neighbour_filled(exposures_ms: FloatArray) -> FloatArray:
    """Return the exposures after DSO has replaced each zero by the mean of its positive neighbours, in order."""
    filled = exposures_ms.copy()
    for i in np.flatnonzero(filled == 0):
        neighbours = [filled[j] for j in (i - 1, i + 1) if 0 <= j < filled.size and filled[j] > 0]
        if neighbours:
            filled[i] = float(np.mean(neighbours))
    return filled
