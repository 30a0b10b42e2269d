"""What is believed before any measurement, and how strongly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.response_basis import ResponseBasis, typical_gamma

LEVEL_SIGMA = 0.6
"""Standard deviation of the logarithm of a camera's gamma about the typical one; two in three of the 201 measured
responses of Grossberg and Nayar (2003) lie within it."""

VIGNETTE_SIGMA = 2.0
"""Standard deviation of each vignette parameter: wide, so that it only matters where nothing was measured."""


@dataclass(frozen=True)
class Prior:
    """A normal distribution of response and vignette parameters.

    The response's local gamma is a typical curve times a level times a random walk from knot to knot, whose step is
    the one number chosen from the data.

    Attributes
    ----------
    mean
        Expected parameters, shape (p,).
    level
        Precision from the spread of the level and of the vignette, shape (p, p).
    walk
        Takes the parameters to the walk's steps, shape (steps, p).
    bend
        Standard deviation of each step that is there whatever the data say, shape (steps,).
    """

    mean: FloatArray
    level: FloatArray
    walk: FloatArray
    bend: FloatArray

    @classmethod
    def of(cls, basis: ResponseBasis, vignette_parameters: int) -> Prior:
        """Return the prior for a response basis and a number of vignette parameters."""
        typical = typical_gamma(basis.knots)
        n, p = len(basis), len(basis) + vignette_parameters
        relative = np.diag(1 / typical)
        middle = (basis.knots[:-1] + basis.knots[1:]) / 2
        # A walk over the whole range has the same spread whatever the number of knots.
        walk = np.zeros((n - 1, p))
        walk[:, :n] = np.diff(np.eye(n), axis=0) @ relative * np.sqrt(n - 1)
        average = np.full(n, 1 / n) @ relative
        level = np.zeros((p, p))
        level[:n, :n] = np.outer(average, average) / LEVEL_SIGMA**2
        level[n:, n:] = np.eye(vignette_parameters) / VIGNETTE_SIGMA**2
        mean = np.concatenate([typical, np.zeros(vignette_parameters)])
        return cls(mean, level, walk, end_bend(middle))

    def precision(self, step: float) -> FloatArray:
        """Return the precision matrix, shape (p, p).

        Parameters
        ----------
        step
            Standard deviation of the walk over the whole range of grey levels, relative to the typical gamma.
        """
        return self.level + self.walk.T @ (self.walk / self._variance(step)[:, None])

    def log_determinant(self, step: float) -> float:
        """Return the part of the log determinant of the precision that depends on the step."""
        return -float(np.sum(np.log(self._variance(step))))

    def _variance(self, step: float) -> FloatArray:
        return np.asarray(step**2 + self.bend**2)


def end_bend(grey: FloatArray) -> FloatArray:
    """Return the steps to expect of any camera near white and black, relative, at grey levels in [0, 1].

    Between grey levels 0.9 and 0.98 the local gamma of the 201 measured responses changes as much as over all the
    rest, however smooth they are elsewhere; near black a toe or a black level may bend the curve likewise.
    """
    return np.asarray(2.5 * grey**12 + (1 - grey) ** 40)
