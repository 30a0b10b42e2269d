"""A prior of inverse responses: a mean, five components, and a mixture of five normal distributions.

This is the prior of Lin et al. 2004 and Lin and Zhang 2005: g = g₀ + Σ cᵢhᵢ, and p(g) = Σ αₖ N(c; μₖ, Σₖ). They
learned it from the measured curves of Grossberg and Nayar's database, which are not distributed here; this one is
learned from the analytic families of :mod:`ospc.unknown_exposures.response_model`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from ospc.arrays import FloatArray
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.settings.single_image import (
    ADDED_PRIOR_VARIANCE,
    DECREASE_WEIGHT,
    EDGE_TOLERANCE,
    MIN_PRIOR_SLOPE,
    PRIOR_COMPONENTS,
    PRIOR_LEVELS,
    PRIOR_NORMALS,
    PRIOR_ROUNDS,
)
from ospc.unknown_exposures.response_model import family_of_inverses


@dataclass(frozen=True)
class ResponsePrior:
    """The prior; coefficients are in standard deviations of the curves that it was learned from.

    ``mean`` and ``components`` are g₀ and hᵢ at 256 grey levels, shapes (256,) and (5, 256). The normal distributions
    have ``log_weights``, ln αₖ plus ln of the normalisation, ``means`` μₖ, and ``precisions``, the inverses of Σₖ,
    shapes (5,), (5, 5) and (5, 5, 5).
    """

    mean: FloatArray
    components: FloatArray
    log_weights: FloatArray
    means: FloatArray
    precisions: FloatArray

    def curve(self, coefficients: FloatArray) -> FloatArray:
        """Return g at 256 grey levels; it may decrease."""
        return np.asarray(self.mean + coefficients @ self.components)

    def response(self, coefficients: FloatArray, name: str) -> Response:
        """Return the response with these coefficients, forced to increase."""
        steps = np.maximum(np.diff(self.curve(coefficients)), MIN_PRIOR_SLOPE / PRIOR_LEVELS)
        model = {"name": name, "coefficients": coefficients.tolist()}
        return Response.from_values(np.append(0.0, np.cumsum(steps)), model=model)

    def cost(self, coefficients: FloatArray) -> float:
        """Return −ln p(g) plus a penalty for decreasing parts of g."""
        offset = coefficients - self.means
        normal = np.einsum("ki,kij,kj->k", offset, self.precisions, offset)
        falls = np.minimum(np.diff(self.curve(coefficients)), 0)
        return float(-np.logaddexp.reduce(self.log_weights - normal / 2) - DECREASE_WEIGHT * falls.sum())

    def most_likely(self, misfit: Callable[[FloatArray], float], weight: float, name: str) -> Response:
        """Return the response that minimises misfit(g) − λ ln p(g), g at 256 grey levels, with λ ``weight``.

        The minimisation starts from the mean of each normal distribution, and the best result is used.
        NotObservableError if the misfit is never finite.
        """

        def total(coefficients: FloatArray) -> float:
            return misfit(self.curve(coefficients)) + weight * self.cost(coefficients)

        ends = [minimize(total, start, method="BFGS", tol=EDGE_TOLERANCE) for start in self.means]
        best = min(ends, key=lambda end: float(end.fun) if np.isfinite(end.fun) else np.inf)
        if not np.isfinite(best.fun):
            raise NotObservableError(f"the method {name} found no response in this image")
        return self.response(np.asarray(best.x), name)


@cache
def response_prior() -> ResponsePrior:
    """Return the prior, learned by expectation maximisation."""
    curves = family_of_inverses(PRIOR_LEVELS)
    mean = curves.mean(axis=0)
    _, singular, directions = np.linalg.svd(curves - mean, full_matrices=False)
    components = directions[:PRIOR_COMPONENTS] * singular[:PRIOR_COMPONENTS, None] / np.sqrt(len(curves))
    coefficients = (curves - mean) @ np.linalg.pinv(components)
    # Initialise from curves sorted by their first component, so that the result is reproducible.
    order = np.argsort(coefficients[:, 0])
    starts = np.array([part.mean(axis=0) for part in np.array_split(coefficients[order], PRIOR_NORMALS)])
    weights, means, covariances = _mixture(coefficients, starts)
    log_weights = np.log(weights) - np.linalg.slogdet(2 * np.pi * covariances)[1] / 2
    return ResponsePrior(
        mean, components, log_weights, means, np.asarray(np.linalg.inv(covariances), dtype=np.float64)
    )


def _mixture(points: FloatArray, means: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit a mixture of normal distributions by expectation maximisation; return weights, means and covariances."""
    ridge = ADDED_PRIOR_VARIANCE * np.eye(points.shape[1])
    weights = np.full(len(means), 1 / len(means))
    covariances = np.array([np.eye(points.shape[1])] * len(means))
    for _ in range(PRIOR_ROUNDS):
        offset = points[:, None] - means
        square = np.einsum("nki,kij,nkj->nk", offset, np.linalg.inv(covariances), offset)
        log = np.log(weights) - np.linalg.slogdet(covariances)[1] / 2 - square / 2
        share = np.exp(log - logsumexp(log, axis=1, keepdims=True))
        total = share.sum(axis=0) + np.finfo(float).tiny
        weights, means = total / len(points), share.T @ points / total[:, None]
        offset = points[:, None] - means
        covariances = np.einsum("nk,nki,nkj->kij", share, offset, offset) / total[:, None, None] + ridge
    return weights, means, covariances
