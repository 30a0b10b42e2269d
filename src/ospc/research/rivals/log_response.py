"""The empirical log-response model ln g = g₀ + Σ cₖhₖ, and the point that fixes its exponent.

Used for Kim, Frahm and Pollefeys 2007, Kim and Pollefeys 2008, Grundmann et al. 2013 and Mo et al. 2019. The
publications use the model of Grossberg and Nayar, whose tables are not distributed here; this one is learned from
analytic families of curves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import isotonic_regression

from ospc.arrays import FloatArray
from ospc.photometry.response import Response
from ospc.unknown_exposures.response_model import family_of_inverses

_LEVELS = 256
_COMPONENTS, _DARKEST = 5, 1e-4
"""Number of components, as in the publications, and irradiance at which ln g is cut off."""

ANCHOR = 128
"""Grey level at which one point of the response fixes the exponent."""

_RIDGE = 1e-4
"""Pull of the coefficients to zero, relative to the mean diagonal of the system, for what no pair determines."""


@dataclass(frozen=True)
class LogModel:
    """g₀, shape (256,), and hₖ, shape (5, 256); coefficients of typical curves have unit variance."""

    mean: FloatArray
    components: FloatArray

    def curve(self, coefficients: FloatArray) -> FloatArray:
        """Return ln g at 256 grey levels."""
        return np.asarray(self.mean + coefficients @ self.components)

    def response(self, coefficients: FloatArray, name: str) -> Response:
        """Return the response with these coefficients, made non-decreasing."""
        rising = np.asarray(isotonic_regression(np.exp(self.curve(coefficients))).x) + 1e-9 * np.arange(_LEVELS)
        rising[0] = 0.0
        return Response.from_values(rising, model={"name": name, "coefficients": coefficients.tolist()})

    def weight(self, grey0: FloatArray, grey1: FloatArray) -> FloatArray:
        """Return the weight of ln g(M₁) − ln g(M₀) for equal noise in grey levels, with M in [0, 255].

        Without weights, the darkest levels, where ln g is steep and noisy, would flatten the whole curve.
        """
        slope = np.abs(np.gradient(self.mean))
        variance = sum(np.interp(grey, np.arange(_LEVELS), slope) ** 2 for grey in (grey0, grey1))
        return np.asarray(float(slope.min()) ** 2 / variance)

    def solved(self, matrix: FloatArray, vector: FloatArray, truth: Response | None, curves: int = 1) -> FloatArray:
        """Solve A c = b with ln g fixed at one grey level, to the truth or else to g₀.

        The first unknowns are the coefficients of the curves, one curve after another.
        """
        size = len(vector)
        wanted = 0.0 if truth is None else float(np.log(truth.inverse(ANCHOR / 255)) - self.mean[ANCHOR])
        known = np.zeros((curves, size))
        known[:, : curves * len(self.components)] = np.kron(np.eye(curves), self.components[:, ANCHOR])
        ridge = _RIDGE * float(np.trace(matrix)) / size * np.eye(size)
        bordered = np.block([[matrix + ridge, known.T], [known, np.zeros((curves, curves))]])
        found = np.linalg.lstsq(bordered, np.append(vector, np.full(curves, wanted)), rcond=None)[0]
        return np.asarray(found[:size], dtype=np.float64)


@cache
def log_model() -> LogModel:
    """Return the model learned from analytic families of curves, with ln g(1) = 0."""
    curves = np.log(np.maximum(family_of_inverses(_LEVELS), _DARKEST))
    mean = curves.mean(axis=0)
    _, singular, directions = np.linalg.svd(curves - mean, full_matrices=False)
    scale = singular[:_COMPONENTS, None] / np.sqrt(len(curves))
    return LogModel(np.asarray(mean), np.asarray(directions[:_COMPONENTS] * scale))
