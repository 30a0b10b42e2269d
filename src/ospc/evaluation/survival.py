"""Survival times, of which some are censored."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, IntArray


class LifeTable:
    """Counts of individuals at risk and lost at every age, in bounded memory.

    Survival is the product-limit estimate (Kaplan and Meier 1958): an individual that is censored, such as a point
    that leaves the image, counts until then, and afterwards neither as lost nor as alive.

    Parameters
    ----------
    horizon
        Age up to which individuals are followed.
    """

    def __init__(self, horizon: int) -> None:
        self._at_risk = np.zeros(horizon, np.int64)
        self._lost = np.zeros(horizon, np.int64)

    def add(self, ages: IntArray, lost_ages: IntArray) -> None:
        """Count one step of several individuals.

        Parameters
        ----------
        ages
            Ages before the step, all below the horizon, shape (n,).
        lost_ages
            Those of the ages that belong to individuals lost in the step.
        """
        self._at_risk += np.bincount(ages, minlength=len(self._at_risk))
        self._lost += np.bincount(lost_ages, minlength=len(self._lost))

    @property
    def steps(self) -> int:
        """Number of steps counted."""
        return int(self._at_risk.sum())

    @property
    def lost(self) -> int:
        """Number of individuals lost."""
        return int(self._lost.sum())

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
