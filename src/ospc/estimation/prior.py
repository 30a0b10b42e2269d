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

SHOULDER_SIGMA = 0.5
"""Standard deviation of the bend of ln γ between grey levels 0.75 and 1, beyond what the curve does below; of the 201
measured responses two in three lie between no bend and one by a factor of 2.6."""

WHITE_SIGMA, BLACK_SIGMA = 0.3, 0.2
"""Standard deviations of what ln γ does besides in the last and first few grey levels."""

_MIDDLE = 0.4
_NUGGET = 1e-6


@dataclass(frozen=True)
class PriorHyperparameters:
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
    PriorHyperparameters(float(walk), float(drift))
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
    vignette_sigma
        Standard deviation of each vignette parameter about zero, shape (q,).
    """

    knots: FloatArray
    about: FloatArray
    vignette_sigma: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Expected parameters, shape (p,)."""
        response = self.about * (1 + np.log(typical_gamma(self.knots)) - np.log(self.about))
        return np.concatenate([response, np.zeros(len(self.vignette_sigma))])

    def precision(self, hyperparameters: PriorHyperparameters) -> FloatArray:
        """Return the precision matrix of the parameters, shape (p, p)."""
        n, p = len(self.knots), len(self.knots) + len(self.vignette_sigma)
        matrix = np.zeros((p, p))
        matrix[:n, :n] = _precision(n, hyperparameters)[0] / np.outer(self.about, self.about)
        matrix[n:, n:] = np.diag(1 / self.vignette_sigma**2)
        return matrix

    def log_determinant(self, hyperparameters: PriorHyperparameters) -> float:
        """Return the part of the log determinant of the precision that depends on the hyperparameters."""
        return _precision(len(self.knots), hyperparameters)[1]


@cache
def _precision(knots: int, hyperparameters: PriorHyperparameters) -> tuple[FloatArray, float]:
    """Return the precision of ln γ at equidistant knots, shape (knots, knots), and its log determinant."""
    grey = np.linspace(0, 1, knots)
    covariance = _covariance(grey, hyperparameters) + _NUGGET * np.eye(knots)
    precision: FloatArray = np.linalg.inv(covariance).astype(np.float64)
    precision.setflags(write=False)
    return precision, -float(np.linalg.slogdet(covariance)[1])


def _covariance(grey: FloatArray, hyperparameters: PriorHyperparameters) -> FloatArray:
    """Return the covariance of ln γ at grey levels, shape (n,) -> (n, n): walks to both sides of the middle."""
    offset = grey - _MIDDLE
    same_side = offset[:, None] * offset > 0
    near, far = (
        np.minimum(np.abs(offset)[:, None], np.abs(offset)),
        np.maximum(np.abs(offset)[:, None], np.abs(offset)),
    )
    walk = np.where(same_side, near, 0.0)
    drift = np.where(same_side, near**2 * (3 * far - near) / 6, 0.0)
    level = LEVEL_SIGMA**2 + SLOPE_SIGMA**2 * offset[:, None] * offset
    return np.asarray(level + hyperparameters.walk**2 * walk + hyperparameters.drift**2 * drift + _ends(grey))


def _ends(grey: FloatArray) -> FloatArray:
    """Return the covariance of what happens at the ends, whatever the curve does between them, shape (n, n)."""
    shoulder = SHOULDER_SIGMA * _shoulder(grey)
    white, black = WHITE_SIGMA**2 * grey**40, BLACK_SIGMA**2 * (1 - grey) ** 40
    return np.asarray(
        np.outer(shoulder, shoulder) + np.minimum(white[:, None], white) + np.minimum(black[:, None], black)
    )


def _shoulder(grey: FloatArray) -> FloatArray:
    return np.clip((grey - 0.75) / 0.25, 0.0, 1.0)
