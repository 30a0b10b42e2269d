"""How long things live when not all of them can be watched to their end."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, IntArray


class LifeTable:
    """Counts of lives watched and lost at every age, in bounded memory.

    Survival is the product-limit estimate (Kaplan and Meier 1958): what stops being watched, as a point that leaves
    the image does, counts up to then and neither as lost nor as alive after it.

    Parameters
    ----------
    horizon
        Age up to which lives are watched.
    """

    def __init__(self, horizon: int) -> None:
        self._watched = np.zeros(horizon, np.int64)
        self._lost = np.zeros(horizon, np.int64)

    def add(self, ages: IntArray, lost_ages: IntArray) -> None:
        """Count one step of several lives.

        Parameters
        ----------
        ages
            Ages below the horizon before the step, shape (n,).
        lost_ages
            The ages among them of those lost in the step.
        """
        self._watched += np.bincount(ages, minlength=len(self._watched))
        self._lost += np.bincount(lost_ages, minlength=len(self._lost))

    @property
    def steps(self) -> int:
        """Number of steps watched."""
        return int(self._watched.sum())

    @property
    def lost(self) -> int:
        """Number of lives that ended."""
        return int(self._lost.sum())

    @property
    def horizon(self) -> int:
        """Age up to which anything is known: that asked for, unless all lives were lost sight of before."""
        unknown = np.flatnonzero((self._watched == 0) & (self.survival[:-1] > 0))
        return int(unknown[0]) if unknown.size else len(self._watched)

    @property
    def survival(self) -> FloatArray:
        """Share alive at the ages 0, 1, … horizon; first 1."""
        kept = 1 - self._lost / np.maximum(self._watched, 1)
        return np.concatenate([[1.0], np.cumprod(kept)])

    def mean_life(self, horizon: int) -> float:
        """Return the mean age reached, in steps counted from 1, of lives watched to an age of ``horizon`` at most."""
        return float(self.survival[:horizon].sum())

    def median_life(self, horizon: int) -> int | None:
        """Return the age that half do not outlive, counted from 1; None where more do."""
        gone = np.flatnonzero(self.survival[: horizon + 1] <= 0.5)
        return int(gone[0]) if gone.size else None
