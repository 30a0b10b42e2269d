"""The prior of response and vignette: a normal distribution whose roughness is selected by the data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.response_basis import typical_gamma
from ospc.settings.estimation import (
    BLACK_SIGMA,
    DRIFT_CANDIDATES,
    END_EXPONENT,
    LEVEL_SIGMA,
    PRIOR_MIDDLE_GREY,
    PRIOR_NUGGET,
    SHOULDER_GREY,
    SHOULDER_SIGMA,
    SLOPE_SIGMA,
    WALK_CANDIDATES,
    WHITE_SIGMA,
)


@dataclass(frozen=True)
class PriorHyperparameters:
    """Expected roughness of ln γ.

    ``walk`` is the standard deviation of a random walk over the whole range of grey levels, which allows kinks
    anywhere; ``drift`` is that of a random walk of the slope, which allows smooth bends.
    """

    walk: float
    drift: float


CANDIDATES = tuple(
    PriorHyperparameters(float(walk), float(drift))
    for walk in np.geomspace(*WALK_CANDIDATES)
    for drift in DRIFT_CANDIDATES
)
"""The hyperparameters from which :meth:`NormalEquations.maximize_evidence` selects."""


@dataclass(frozen=True)
class Prior:
    """A normal distribution of ln γ at the knots and of all other parameters, linearised in γ.

    Attributes
    ----------
    knots, about
        Grey levels of the response's knots, and the coefficients at which ln γ is linearised, shape (n,).
    further_sigma
        Standard deviation about zero of each other parameter, those of the vignette and of effects, shape (q,).
    """

    knots: FloatArray
    about: FloatArray
    further_sigma: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Expected parameters, shape (p,)."""
        response = self.about * (1 + np.log(typical_gamma(self.knots)) - np.log(self.about))
        return np.concatenate([response, np.zeros(len(self.further_sigma))])

    def precision(self, hyperparameters: PriorHyperparameters) -> FloatArray:
        """Return the precision matrix of the parameters, shape (p, p)."""
        return self._with_further(_precision(len(self.knots), hyperparameters)[0])

    def of_candidates(self) -> tuple[FloatArray, FloatArray]:
        """Return the precision matrix for each of :data:`CANDIDATES`, shape (c, p, p), and the log determinant, (c,).

        The log determinant contains only the part that depends on the hyperparameters.
        """
        precisions, log_determinants = _of_candidates(len(self.knots))
        return self._with_further(precisions), log_determinants

    def _with_further(self, precision: FloatArray) -> FloatArray:
        """Return the precision of all parameters, (..., p, p), from that of ln γ at the knots, (..., n, n)."""
        n, p = len(self.knots), len(self.knots) + len(self.further_sigma)
        matrix = np.zeros((*precision.shape[:-2], p, p))
        matrix[..., :n, :n] = precision / np.outer(self.about, self.about)
        matrix[..., n:, n:] = np.diag(1 / self.further_sigma**2)
        return matrix


@cache
def _precision(knots: int, hyperparameters: PriorHyperparameters) -> tuple[FloatArray, float]:
    """Return the precision of ln γ at equidistant knots, shape (knots, knots), and its log determinant."""
    grey = np.linspace(0, 1, knots)
    covariance = _covariance(grey, hyperparameters) + PRIOR_NUGGET * np.eye(knots)
    precision: FloatArray = np.linalg.inv(covariance).astype(np.float64)
    precision.setflags(write=False)
    return precision, -float(np.linalg.slogdet(covariance)[1])


@cache
def _of_candidates(knots: int) -> tuple[FloatArray, FloatArray]:
    """Return the result of :func:`_precision` for each candidate, shapes (c, knots, knots) and (c,)."""
    precisions, log_determinants = zip(*(_precision(knots, candidate) for candidate in CANDIDATES), strict=True)
    return np.stack(precisions), np.array(log_determinants)


def _covariance(grey: FloatArray, hyperparameters: PriorHyperparameters) -> FloatArray:
    """Return the covariance of ln γ at grey levels, shape (n,) -> (n, n): random walks from the middle outwards."""
    offset = grey - PRIOR_MIDDLE_GREY
    same_side = offset[:, None] * offset > 0
    distance = np.abs(offset)
    near, far = np.minimum(distance[:, None], distance), np.maximum(distance[:, None], distance)
    walk = np.where(same_side, near, 0.0)
    drift = np.where(same_side, near**2 * (3 * far - near) / 6, 0.0)
    level = LEVEL_SIGMA**2 + SLOPE_SIGMA**2 * offset[:, None] * offset
    return np.asarray(level + hyperparameters.walk**2 * walk + hyperparameters.drift**2 * drift + _ends(grey))


def _ends(grey: FloatArray) -> FloatArray:
    """Return the covariance of ln γ at both ends that is independent of the curve in the middle, shape (n, n)."""
    shoulder = SHOULDER_SIGMA * np.clip((grey - SHOULDER_GREY) / (1 - SHOULDER_GREY), 0.0, 1.0)
    white, black = WHITE_SIGMA**2 * grey**END_EXPONENT, BLACK_SIGMA**2 * (1 - grey) ** END_EXPONENT
    return np.asarray(
        np.outer(shoulder, shoulder) + np.minimum(white[:, None], white) + np.minimum(black[:, None], black)
    )
