"""Statistics of streams in bounded memory: survival times, of which some are censored, and the median."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, IntArray

_LOWEST, _HIGHEST, _BINS = 1e-5, 1e4, 4096
"""Range and number of the bins of a median: each is half a per cent wide."""


class LifeTable:
    """Counts of individuals at risk and lost at every age up to a horizon.

    Survival is the product-limit estimate (Kaplan and Meier 1958): an individual that is censored, such as a point
    that leaves the image, counts until then, and afterwards neither as lost nor as alive.
    """

    def __init__(self, horizon: int) -> None:
        self._at_risk = np.zeros(horizon, np.int64)
        self._lost = np.zeros(horizon, np.int64)

    def add(self, ages: IntArray, lost_ages: IntArray) -> None:
        """Count a step of individuals by their ages before it, all below the horizon, and those lost in it."""
        self._at_risk += np.bincount(ages, minlength=len(self._at_risk))
        self._lost += np.bincount(lost_ages, minlength=len(self._lost))

    @property
    def steps(self) -> int:
        """Number of steps counted."""
        return int(self._at_risk.sum())

    @property
    def horizon(self) -> int:
        """Age up to which survival is known: the one asked for, unless all were censored before."""
        unknown = np.flatnonzero((self._at_risk == 0) & (self.survival[:-1] > 0))
        return int(unknown[0]) if unknown.size else len(self._at_risk)

    @property
    def survival(self) -> FloatArray:
        """Share alive at the ages 0, 1, … horizon, shape (horizon + 1,); the first is 1."""
        kept = 1 - self._lost / np.maximum(self._at_risk, 1)
        return np.concatenate([[1.0], np.cumprod(kept)])

    def mean_life(self, horizon: int) -> float:
        """Return the mean age reached, counted from 1, of individuals followed to an age of at most ``horizon``."""
        return float(self.survival[:horizon].sum())

    def median_life(self, horizon: int) -> int | None:
        """Return the age that half do not outlive, counted from 1; None if more do."""
        gone = np.flatnonzero(self.survival[: horizon + 1] <= 0.5)
        return int(gone[0]) if gone.size else None


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
    def value(self) -> float:
        """The median; NaN if nothing was counted."""
        count = int(self._counts.sum())
        if count == 0:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self._counts), count / 2))
        return float(_LOWEST * (_HIGHEST / _LOWEST) ** ((place + 0.5) / _BINS))
