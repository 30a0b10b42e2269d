"""Rules for the numbers in a state: limits and shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ospc.errors import FormatError
from ospc.settings.brightness import GREY_BIN_EDGES
from ospc.settings.lag import MOST_LAG_FRAMES
from ospc.settings.methods import CHANGE_GREY_KNOTS

MOST = 2**40
"""Largest count: a thousand frames per second for thirty years."""
LARGEST = 1e12
"""Largest magnitude of any other number: no measurement comes close, and its square is finite."""
LOG = 50.0
"""Largest magnitude of the logarithm of an exposure in milliseconds or of a ratio."""
CHANGES, BINS = len(CHANGE_GREY_KNOTS) + 5, len(GREY_BIN_EDGES) - 1
"""Number of parameters of a camera change, and of grey bins of a brightness change."""


@dataclass(frozen=True)
class Numbers:
    """A number, or a list or array of numbers, between two limits; NaN is allowed only if ``unknown``.

    ``shape`` has lengths, or names of lengths that must agree within a dataclass; it is empty for a single number.
    ``most`` is the largest length of the first axis.
    """

    low: float = -LARGEST
    high: float = LARGEST
    shape: tuple[int | str, ...] = ()
    unknown: bool = False
    most: int = MOST

    def check(self, name: str, value: Any, lengths: dict[str, int] | None = None) -> None:
        """Raise a FormatError if a value breaks the rule; add named lengths to ``lengths``."""
        known = {} if lengths is None else lengths
        try:
            array = np.asarray(value)
        except ValueError:
            raise FormatError(f"{name} has rows of different lengths") from None
        if array.size == 0 and array.ndim == 1 and len(self.shape) > 1:
            array = array.reshape(0, *(known.get(n, 0) if isinstance(n, str) else n for n in self.shape[1:]))
        wanted = tuple(
            known.setdefault(n, m) if isinstance(n, str) else n for n, m in zip(self.shape, array.shape, strict=False)
        )
        if array.ndim != len(self.shape) or array.shape != wanted:
            raise FormatError(f"{name} has the shape {array.shape} instead of {self.shape}")
        if array.ndim and len(array) > self.most:
            raise FormatError(f"{name} has {len(array)} entries, more than {self.most}")
        within = (array >= self.low) & (array <= self.high)
        if not np.all(within | np.isnan(array) if self.unknown else within):
            raise FormatError(f"{name} is not between {self.low:g} and {self.high:g}")


LAG = Numbers(-MOST_LAG_FRAMES, MOST_LAG_FRAMES)
"""A lag of the exposures, or a change of the lag, in frames."""
COUNT = Numbers(0, MOST)
"""A count or a frame number."""
UNIT = Numbers(0, 1)
"""A share, or a grey level relative to white."""


def logs(*shape: int | str, unknown: bool = False, most: int = MOST) -> Numbers:
    """Return the rule for logarithms of exposures or ratios of a shape."""
    return Numbers(-LOG, LOG, shape, unknown, most)


def count(*shape: int | str, most: int = MOST) -> Numbers:
    """Return the rule for counts or numbers of frames of a shape."""
    return Numbers(0, MOST, shape, most=most)


def share(*shape: int | str, unknown: bool = False, most: int = MOST) -> Numbers:
    """Return the rule for shares or relative grey levels of a shape; sums of shares may be rounded."""
    return Numbers(0, 1.001, shape, unknown, most)


def require(holds: Any, otherwise: str) -> None:
    """Raise a FormatError with a text unless something holds."""
    if not holds:
        raise FormatError(otherwise)


def check_settings(name: str, found: object, new: object, settings: str) -> None:
    """Require that some attributes, named in a text, are as in a new object of the same settings."""
    for field in settings.split():
        same = getattr(found, field) == getattr(new, field)
        require(same, f"{name}.{field} differs from its settings")
