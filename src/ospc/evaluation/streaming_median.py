"""The median of a stream of positive numbers, in bounded memory."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray

_LOWEST, _HIGHEST, _BINS = 1e-5, 1e4, 4096
"""Range and number of the bins: each is half a per cent wide."""


class StreamingMedian:
    """Counts numbers in bins of equal ratio from 10⁻⁵ to 10⁴; the median is accurate to a quarter of a per cent."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, np.int64)

    def add(self, values: FloatArray) -> None:
        """Count numbers; those out of range are clipped to it, those that are not finite are ignored."""
        finite = values[np.isfinite(values)]
        share = np.log(np.clip(finite, _LOWEST, _HIGHEST) / _LOWEST) / np.log(_HIGHEST / _LOWEST)
        self._counts += np.bincount(np.minimum((share * _BINS).astype(np.int64), _BINS - 1), minlength=_BINS)

    @property
    def count(self) -> int:
        """Number of values counted."""
        return int(self._counts.sum())

    @property
    def value(self) -> float:
        """The median; NaN if nothing was counted."""
        if self.count == 0:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self._counts), self.count / 2))
        return float(_LOWEST * (_HIGHEST / _LOWEST) ** ((place + 0.5) / _BINS))
