"""The prior of response and vignette: a normal distribution whose hyperparameters are selected by the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ospc.arrays import FloatArray, read_only
from ospc.estimation.response_basis import ResponseBasis, typical_gamma
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.photometry.non_radial import NON_RADIAL
from ospc.settings.response import (
    BLACK_SIGMA,
    DRIFT_CANDIDATES,
    END_EXPONENT,
    KNEE_SIGMA,
    LEVEL_SIGMA,
    PRIOR_MIDDLE_GREY,
    PRIOR_NUGGET,
    SHOULDER_GREY,
    SHOULDER_SIGMA,
    SLOPE_SIGMA,
    START_DRIFT,
    START_WALK,
    TOE_GREY,
    TOE_SIGMA,
    WALK_CANDIDATES,
    WHITE_SIGMA,
)
from ospc.settings.vignette import (
    CENTRE_SIGMA,
    DARK_RADIUS,
    NON_RADIAL_SIGMA,
    START_VIGNETTE_WALK,
    VIGNETTE_NUGGET,
    VIGNETTE_REACH,
    VIGNETTE_SIGMA,
    VIGNETTE_WALK_CANDIDATES,
)

_KEPT_TABLES = 16
"""Number of precisions kept, of the response and of the vignette each: those of all candidates of the response take
1 MB, and the vignette has few candidates."""


@dataclass(frozen=True)
class PriorHyperparameters:
    """Expected roughness of ln γ and of ln V.

    ``walk`` is the standard deviation of a random walk over the whole range of grey levels, which allows kinks
    anywhere; ``drift`` is that of a random walk of the slope, which allows smooth bends. ``vignette_walk`` is that of
    the slope of ln V in R², see :func:`vignette_precision`. ``knees`` are the numbers of the knots near which ln γ
    may jump, as that of a piecewise linear response does.
    """

    walk: float
    drift: float
    vignette_walk: float
    knees: tuple[int, ...] = ()

    @property
    def response_candidates(self) -> list[PriorHyperparameters]:
        """All candidates for the roughness of the response, with these knees and this roughness of the vignette."""
        walks = np.geomspace(*WALK_CANDIDATES).tolist()
        return [replace(self, walk=walk, drift=drift) for walk in walks for drift in DRIFT_CANDIDATES]

    @property
    def smooth_candidates(self) -> list[PriorHyperparameters]:
        """Those of them without kinks except at the knees."""
        return self.response_candidates[: len(DRIFT_CANDIDATES)]

    @property
    def vignette_candidates(self) -> list[PriorHyperparameters]:
        """All candidates for the vignette, with this roughness of the response."""
        return [replace(self, vignette_walk=walk) for walk in VIGNETTE_WALK_CANDIDATES]


START = PriorHyperparameters(START_WALK, START_DRIFT, START_VIGNETTE_WALK)
"""The hyperparameters until they are first selected."""


@dataclass(frozen=True)
class Prior:
    """A normal distribution of ln γ at the knots and of all other parameters, linearised in γ."""

    response: ResponseBasis
    """Basis of the response."""
    vignette: VignetteBasis
    """Basis of the vignette."""
    about: FloatArray
    """Coefficients of the response at which ln γ is linearised, shape (n,)."""
    effect_sigma: FloatArray
    """Standard deviation about zero of each effect, shape (e,)."""

    @property
    def of_response(self) -> Prior:
        """The prior of the response alone."""
        return Prior(self.response, VignetteBasis(0), self.about, np.zeros(0))

    @property
    def mean(self) -> FloatArray:
        """Expected parameters, shape (p,)."""
        response = self.about * (1 + np.log(typical_gamma(self.response.knots)) - np.log(self.about))
        return np.concatenate([response, np.zeros(len(self.vignette) + len(self.effect_sigma))])

    def precision(self, hyperparameters: PriorHyperparameters) -> FloatArray:
        """Return the precision matrix of the parameters, shape (p, p)."""
        matrices, _ = self.of_candidates([hyperparameters])
        return np.asarray(matrices[0])

    def of_candidates(self, candidates: Sequence[PriorHyperparameters]) -> tuple[FloatArray, FloatArray]:
        """Return the precision matrix for each candidate, shape (c, p, p), and the log determinant, (c,).

        The log determinant contains only the part that depends on the hyperparameters.
        """
        n, m = len(self.response), len(self.response) + len(self.vignette)
        response, of_response = _response_precisions(
            self.response, tuple((c.walk, c.drift, c.knees) for c in candidates)
        )
        walks = {c.vignette_walk for c in candidates}  # those of the response have only one
        of_walk = {walk: vignette_precision(self.vignette, walk) for walk in walks}
        vignette, of_vignette = zip(*(of_walk[c.vignette_walk] for c in candidates), strict=True)
        matrices = np.zeros((len(candidates), m + len(self.effect_sigma), m + len(self.effect_sigma)))
        matrices[:, :n, :n] = response / np.outer(self.about, self.about)
        matrices[:, n:m, n:m] = vignette
        matrices[:, m:, m:] = np.diag(self.effect_sigma**-2.0)
        return matrices, np.add(of_response, of_vignette)


def vignette_precision(basis: VignetteBasis, walk: float) -> tuple[FloatArray, float]:
    """Return the prior precision of a vignette's parameters about zero, shape (v, v), and its log determinant.

    The slopes of ln V = Σ aₖ R²ᵏ, where the standard deviation of each aₖ is proportional to the coefficient of
    ln(1 − R²/D²), have a covariance that decreases with the distance of both radii from D, the radius at which V may
    reach zero. This prior only allows smooth curves. Mechanical vignetting, which begins at some radius, needs a
    random walk of the slope over R. ``walk`` is its standard deviation at the usable radius, times the square of that
    radius. The log determinant contains only the part that depends on it.
    """
    further = [CENTRE_SIGMA] * (2 * basis.free_centre) + [NON_RADIAL_SIGMA] * (len(NON_RADIAL) * basis.non_radial)
    precision = np.diag(np.concatenate([np.ones(basis.radial), np.array(further) ** -2.0]))
    radial, log_determinant = _radial_precision(basis.radial, basis.usable_radius, basis.reach, walk)
    precision[: basis.radial, : basis.radial] = radial
    return precision, float(log_determinant)


@lru_cache(maxsize=_KEPT_TABLES)
def _radial_precision(knots: int, usable_radius: float, reach: float, walk: float) -> tuple[FloatArray, FloatArray]:
    """Return the precision of the slopes of ln V at the knots, shape (knots, knots), and its log determinant."""
    squared = VignetteBasis(knots, usable_radius=usable_radius, reach=reach).spline.knots
    dark_radius = DARK_RADIUS + (reach - VIGNETTE_REACH)
    smooth = VIGNETTE_SIGMA**2 / (1 - np.outer(squared, squared) / (dark_radius * usable_radius) ** 4)
    radius = np.sqrt(squared)
    random_walk = walk**2 / usable_radius**5 * np.minimum.outer(radius, radius)
    return _inverted(smooth + random_walk + VIGNETTE_NUGGET * np.eye(knots))


@lru_cache(maxsize=_KEPT_TABLES)
def _response_precisions(
    basis: ResponseBasis, candidates: tuple[tuple[float, float, tuple[int, ...]], ...]
) -> tuple[FloatArray, FloatArray]:
    """Return precisions of ln γ at the knots, (c, knots, knots), of walks, drifts and knees; log determinants."""
    nugget, jumps = PRIOR_NUGGET * np.eye(len(basis)), jumps_of_knees(basis.knots)
    covariances = [
        _covariance(basis.knots, walk, drift) + nugget + sum(jump.T @ jump for jump in jumps[list(knees)])
        for walk, drift, knees in candidates
    ]
    return _inverted(np.stack(covariances))


def _inverted(covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the precision matrices of covariances, (…, n, n), to be shared, and their log determinants, (…)."""
    precisions: FloatArray = np.linalg.inv(covariances).astype(np.float64)
    return read_only(precisions), -np.asarray(np.linalg.slogdet(covariances)[1])


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


def jumps_of_knees(knots: FloatArray) -> FloatArray:
    """Return the two changes of ln γ that a knee near each knot allows, one standard deviation each, (n, 2, n).

    These are a jump, on the far side of the grey level where the random walks start, and any value at the knot: the
    knee may lie anywhere within half an interval.
    """
    number, of_knee = np.arange(len(knots)), np.arange(len(knots))[:, None]
    beyond = np.where(knots[:, None] > PRIOR_MIDDLE_GREY, number > of_knee, number < of_knee)
    return KNEE_SIGMA * np.stack([beyond, number == of_knee], axis=1)


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
