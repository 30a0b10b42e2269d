"""The prior of response and vignette: a normal distribution whose hyperparameters are selected by the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.response_basis import typical_gamma
from ospc.estimation.vignette_basis import VignetteBasis
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
    START_DRIFT,
    START_VIGNETTE_WALK,
    START_WALK,
    TOE_GREY,
    TOE_SIGMA,
    VIGNETTE_WALK_CANDIDATES,
    WALK_CANDIDATES,
    WHITE_SIGMA,
)


@dataclass(frozen=True)
class PriorHyperparameters:
    """Expected roughness of ln γ and of ln V.

    ``walk`` is the standard deviation of a random walk over the whole range of grey levels, which allows kinks
    anywhere; ``drift`` is that of a random walk of the slope, which allows smooth bends. ``vignette_walk`` is that of
    the slope of ln V in R², see :meth:`VignetteBasis.prior_precision`.
    """

    walk: float
    drift: float
    vignette_walk: float

    @property
    def of_response(self) -> list[PriorHyperparameters]:
        """All candidates for the response, with this roughness of the vignette."""
        walks = np.geomspace(*WALK_CANDIDATES).tolist()
        return [replace(self, walk=walk, drift=drift) for walk in walks for drift in DRIFT_CANDIDATES]

    @property
    def of_vignette(self) -> list[PriorHyperparameters]:
        """All candidates for the vignette, with this roughness of the response."""
        return [replace(self, vignette_walk=walk) for walk in VIGNETTE_WALK_CANDIDATES]


START = PriorHyperparameters(START_WALK, START_DRIFT, START_VIGNETTE_WALK)
"""The hyperparameters until they are first selected."""


@dataclass(frozen=True)
class Prior:
    """A normal distribution of ln γ at the knots and of all other parameters, linearised in γ.

    Attributes
    ----------
    knots, about
        Grey levels of the response's knots, and the coefficients at which ln γ is linearised, shape (n,).
    vignette
        Basis of the vignette.
    effect_sigma
        Standard deviation about zero of each effect, shape (e,).
    """

    knots: FloatArray
    about: FloatArray
    vignette: VignetteBasis
    effect_sigma: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Expected parameters, shape (p,)."""
        response = self.about * (1 + np.log(typical_gamma(self.knots)) - np.log(self.about))
        return np.concatenate([response, np.zeros(len(self.vignette) + len(self.effect_sigma))])

    def precision(self, hyperparameters: PriorHyperparameters) -> FloatArray:
        """Return the precision matrix of the parameters, shape (p, p)."""
        matrices, _ = self.of_candidates([hyperparameters])
        return np.asarray(matrices[0])

    def of_candidates(self, candidates: Sequence[PriorHyperparameters]) -> tuple[FloatArray, FloatArray]:
        """Return the precision matrix for each candidate, shape (c, p, p), and the log determinant, (c,).

        The log determinant contains only the part that depends on the hyperparameters.
        """
        n, m = len(self.knots), len(self.knots) + len(self.vignette)
        response, of_response = zip(*(_precision(n, c.walk, c.drift) for c in candidates), strict=True)
        vignette, of_vignette = zip(
            *(self.vignette.prior_precision(c.vignette_walk) for c in candidates), strict=True
        )
        matrices = np.zeros((len(candidates), m + len(self.effect_sigma), m + len(self.effect_sigma)))
        matrices[:, :n, :n] = np.stack(response) / np.outer(self.about, self.about)
        matrices[:, n:m, n:m] = vignette
        matrices[:, m:, m:] = np.diag(self.effect_sigma**-2.0)
        return matrices, np.add(of_response, of_vignette)


@cache
def _precision(knots: int, walk: float, drift: float) -> tuple[FloatArray, float]:
    """Return the precision of ln γ at equidistant knots, shape (knots, knots), and its log determinant."""
    covariance = _covariance(np.linspace(0, 1, knots), walk, drift) + PRIOR_NUGGET * np.eye(knots)
    precision: FloatArray = np.linalg.inv(covariance).astype(np.float64)
    precision.setflags(write=False)
    return precision, -float(np.linalg.slogdet(covariance)[1])


def _covariance(grey: FloatArray, walk: float, drift: float) -> FloatArray:
    """Return the covariance of ln γ at grey levels, shape (n,) -> (n, n): random walks from the middle outwards."""
    offset = grey - PRIOR_MIDDLE_GREY
    same_side = offset[:, None] * offset > 0
    distance = np.abs(offset)
    near, far = np.minimum(distance[:, None], distance), np.maximum(distance[:, None], distance)
    of_walk = np.where(same_side, near, 0.0)
    of_drift = np.where(same_side, near**2 * (3 * far - near) / 6, 0.0)
    level = LEVEL_SIGMA**2 + SLOPE_SIGMA**2 * offset[:, None] * offset
    return np.asarray(level + walk**2 * of_walk + drift**2 * of_drift + _ends(grey))


def _ends(grey: FloatArray) -> FloatArray:
    """Return the covariance of ln γ at both ends that is independent of the curve in the middle, shape (n, n)."""
    toe = TOE_SIGMA * np.clip((TOE_GREY - grey) / TOE_GREY, 0.0, 1.0)
    shoulder = SHOULDER_SIGMA * np.clip((grey - SHOULDER_GREY) / (1 - SHOULDER_GREY), 0.0, 1.0)
    white, black = WHITE_SIGMA**2 * grey**END_EXPONENT, BLACK_SIGMA**2 * (1 - grey) ** END_EXPONENT
    return np.asarray(
        np.outer(toe, toe)
        + np.outer(shoulder, shoulder)
        + np.minimum(white[:, None], white)
        + np.minimum(black[:, None], black)
    )
