"""A prior of inverse responses: a mean, five components, and a normal distribution of their coefficients.

This is the prior of Lin et al. 2004 and Lin and Zhang 2005: g = g₀ + Σ cᵢhᵢ. They learned it, with a mixture of five
normal distributions, from the measured curves of Grossberg and Nayar's database, which are not distributed here; this
one is learned from the analytic families of :mod:`ospc.unknown_exposures.response_model`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import minimize

from ospc.arrays import FloatArray
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.settings.single_image import (
    DECREASE_WEIGHT,
    EDGE_TOLERANCE,
    MIN_PRIOR_SLOPE,
    PRIOR_COMPONENTS,
    PRIOR_LEVELS,
    PRIOR_VARIANCE,
)
from ospc.unknown_exposures.response_model import family_of_inverses


@dataclass(frozen=True)
class ResponsePrior:
    """The prior; coefficients are in standard deviations of the curves that it was learned from.

    ``mean`` and ``components`` are g₀ and hᵢ at 256 grey levels, shapes (256,) and (5, 256).
    """

    mean: FloatArray
    components: FloatArray

    def curve(self, coefficients: FloatArray) -> FloatArray:
        """Return g at 256 grey levels; it may decrease."""
        return np.asarray(self.mean + coefficients @ self.components)

    def response(self, coefficients: FloatArray, name: str) -> Response:
        """Return the response with these coefficients, forced to increase."""
        steps = np.maximum(np.diff(self.curve(coefficients)), MIN_PRIOR_SLOPE / PRIOR_LEVELS)
        model = {"name": name, "coefficients": coefficients.tolist()}
        return Response.from_values(np.append(0.0, np.cumsum(steps)), model=model)

    def cost(self, coefficients: FloatArray) -> float:
        """Return −ln p(g), up to a constant, plus a penalty for decreasing parts of g."""
        falls = np.minimum(np.diff(self.curve(coefficients)), 0)
        return float(coefficients @ coefficients / (2 * PRIOR_VARIANCE) - DECREASE_WEIGHT * falls.sum())

    def most_likely(self, misfit: Callable[[FloatArray], float], weight: float, name: str) -> Response:
        """Return the response that minimises misfit(g) − λ ln p(g), g at 256 grey levels, with λ ``weight``.

        NotObservableError if the misfit is never finite.
        """

        def total(coefficients: FloatArray) -> float:
            return misfit(self.curve(coefficients)) + weight * self.cost(coefficients)

        best = minimize(total, np.zeros(PRIOR_COMPONENTS), method="BFGS", tol=EDGE_TOLERANCE)
        if not np.isfinite(best.fun):
            raise NotObservableError(f"the method {name} found no response in this image")
        return self.response(np.asarray(best.x), name)


@cache
def response_prior() -> ResponsePrior:
    """Return the prior, learned from the principal components of the curves."""
    curves = family_of_inverses(PRIOR_LEVELS)
    mean = curves.mean(axis=0)
    _, singular, directions = np.linalg.svd(curves - mean, full_matrices=False)
    return ResponsePrior(
        mean, directions[:PRIOR_COMPONENTS] * singular[:PRIOR_COMPONENTS, None] / np.sqrt(len(curves))
    )
