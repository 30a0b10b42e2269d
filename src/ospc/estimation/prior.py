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
    roughness
        Precision of a random walk of unit steps, shape (p, p).
    steps
        Number of steps of the walk.
    """

    mean: FloatArray
    level: FloatArray
    roughness: FloatArray
    steps: int

    @classmethod
    def of(cls, basis: ResponseBasis, vignette_parameters: int) -> Prior:
        """Return the prior for a response basis and a number of vignette parameters."""
        typical = typical_gamma(basis.knots)
        n, p = len(basis), len(basis) + vignette_parameters
        relative = np.diag(1 / typical)
        middle = (basis.knots[:-1] + basis.knots[1:]) / 2
        walk = (np.diff(np.eye(n), axis=0) / shoulder_steps(middle)[:, None]) @ relative
        average = np.full(n, 1 / n) @ relative
        roughness, level = np.zeros((p, p)), np.zeros((p, p))
        # A walk over the whole range has the same spread whatever the number of knots.
        roughness[:n, :n] = walk.T @ walk * (n - 1)
        level[:n, :n] = np.outer(average, average) / LEVEL_SIGMA**2
        level[n:, n:] = np.eye(vignette_parameters) / VIGNETTE_SIGMA**2
        return cls(np.concatenate([typical, np.zeros(vignette_parameters)]), level, roughness, n - 1)

    def precision(self, step: float) -> FloatArray:
        """Return the precision matrix, shape (p, p).

        Parameters
        ----------
        step
            Standard deviation of the walk over the whole range of grey levels, relative to the typical gamma.
        """
        return self.level + self.roughness / step**2

    def log_determinant(self, step: float) -> float:
        """Return the part of the log determinant of the precision that depends on the step."""
        return -2 * self.steps * float(np.log(step))


def shoulder_steps(grey: FloatArray) -> FloatArray:
    """Return how much larger steps of the walk are at grey levels in [0, 1] than in the middle.

    Near white, responses bend at will: between grey levels 0.9 and 0.98 the local gamma of the 201 measured responses
    changes as much as over all the rest.
    """
    return np.asarray(1 + 5 * grey**10)
