"""What is believed before any measurement, and how strongly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.response_basis import typical_gamma

LEVEL_SIGMA = 0.6
"""Standard deviation of the logarithm of a camera's gamma about the typical one; two in three of the 201 measured
responses of Grossberg and Nayar (2003) lie within it."""

SLOPE_SIGMA = 1.0
"""Standard deviation of the slope of ln γ over the whole range of grey levels, in the middle."""

VIGNETTE_SIGMA = 2.0
"""Standard deviation of each vignette parameter: wide, so that it only matters where nothing was measured."""

_MIDDLE = 0.4
_NUGGET = 1e-6


@dataclass(frozen=True)
class Roughness:
    """How much the logarithm of the local gamma wanders over the range of grey levels.

    Attributes
    ----------
    walk
        Standard deviation of a random walk over the whole range: kinks anywhere.
    drift
        Standard deviation, over the whole range, of a random walk of the slope: smooth bends, going on as they began.
    """

    walk: float
    drift: float


CANDIDATES = tuple(
    Roughness(float(walk), float(drift))
    for walk in np.geomspace(0.03, 10.0, 11)
    for drift in (0.3, 1.0, 3.0, 10.0, 30.0)
)


@dataclass(frozen=True)
class Prior:
    """A normal distribution of ln γ at the knots and of the vignette's parameters, linearised in γ.

    Attributes
    ----------
    knots
        Grey levels of the response's knots, shape (n,).
    about
        Response coefficients about which the logarithm is linearised, shape (n,).
    vignette_parameters
        Number of vignette parameters.
    """

    knots: FloatArray
    about: FloatArray
    vignette_parameters: int

    @property
    def mean(self) -> FloatArray:
        """Expected parameters, shape (p,)."""
        response = self.about * (1 + np.log(typical_gamma(self.knots)) - np.log(self.about))
        return np.concatenate([response, np.zeros(self.vignette_parameters)])

    def precision(self, roughness: Roughness) -> FloatArray:
        """Return the precision matrix of the parameters, shape (p, p)."""
        n, p = len(self.knots), len(self.knots) + self.vignette_parameters
        matrix = np.zeros((p, p))
        matrix[:n, :n] = _precision(n, roughness)[0] / np.outer(self.about, self.about)
        matrix[n:, n:] = np.eye(self.vignette_parameters) / VIGNETTE_SIGMA**2
        return matrix

    def log_determinant(self, roughness: Roughness) -> float:
        """Return the part of the log determinant of the precision that depends on the roughness."""
        return _precision(len(self.knots), roughness)[1]


@cache
def _precision(knots: int, roughness: Roughness) -> tuple[FloatArray, float]:
    """Return the precision of ln γ at equidistant knots, shape (knots, knots), and its log determinant."""
    grey = np.linspace(0, 1, knots)
    covariance = _covariance(grey, roughness) + _NUGGET * np.eye(knots)
    precision: FloatArray = np.linalg.inv(covariance).astype(np.float64)
    precision.setflags(write=False)
    return precision, -float(np.linalg.slogdet(covariance)[1])


def _covariance(grey: FloatArray, roughness: Roughness) -> FloatArray:
    """Return the covariance of ln γ at grey levels, shape (n,) -> (n, n): walks to both sides of the middle."""
    offset = _stretched(grey) - _stretched(np.array(_MIDDLE))
    same_side = offset[:, None] * offset > 0
    near, far = (
        np.minimum(np.abs(offset)[:, None], np.abs(offset)),
        np.maximum(np.abs(offset)[:, None], np.abs(offset)),
    )
    walk = np.where(same_side, near, 0.0)
    drift = np.where(same_side, near**2 * (3 * far - near) / 6, 0.0)
    level = LEVEL_SIGMA**2 + SLOPE_SIGMA**2 * offset[:, None] * offset
    return np.asarray(level + roughness.walk**2 * walk + roughness.drift**2 * drift)


def _stretched(grey: FloatArray) -> FloatArray:
    """Return grey levels on a scale that is stretched towards white and black, where responses bend.

    Between grey levels 0.9 and 0.98 the local gamma of the 201 measured responses changes as much as over all the
    rest; near black a toe or a black level may bend the curve likewise.
    """
    return np.asarray(grey + 0.6 * grey**12 - 0.05 * (1 - grey) ** 40)
