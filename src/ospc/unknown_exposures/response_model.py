"""A low-dimensional model of camera responses: a mean curve and its principal variations.

The empirical model of response (EMoR; Grossberg and Nayar, "Modeling the space of camera response functions", 2004)
is f = f₀ + Σ cₖ hₖ, learned from measured curves. This model has the same form, but is learned from analytic
families that resemble camera responses: powers, video curves with a linear toe, logarithms, sigmoids, and
combinations of these with a knee.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, read_only
from ospc.photometry.response import Response
from ospc.settings.unknown_exposures import (
    EVERY_WITH_KNEE,
    FAMILY_GAMMAS,
    FAMILY_KNEES,
    FAMILY_LOGARITHMS,
    FAMILY_SIGMOID_MIDDLES,
    FAMILY_SIGMOID_POWERS,
    FAMILY_TOE_GAMMAS,
    FAMILY_TOES,
    MIN_RESPONSE_SLOPE,
    RESPONSE_COMPONENTS,
    RESPONSE_SAMPLES,
)


@dataclass(frozen=True)
class ResponseModel:
    """f(x) = f₀(x) + Σ cₖ hₖ(x) for irradiances x in [0, 1].

    ``mean`` is f₀ at equidistant irradiances from 0 to 1, shape (1024,), and ``components`` are the hₖ, shape
    (n, 1024), zero at both ends.
    """

    mean: FloatArray
    components: FloatArray

    def curve(self, coefficients: npt.ArrayLike) -> FloatArray:
        """Return f at the equidistant irradiances, shape (1024,), forced to increase."""
        return _increasing(self.mean + np.asarray(coefficients, dtype=np.float64) @ self.components)

    def coefficients_of(self, response: Response) -> FloatArray:
        """Return the least squares coefficients of a response, shape (n,)."""
        target = response(np.linspace(0, 1, RESPONSE_SAMPLES)) - self.mean
        return np.asarray(np.linalg.lstsq(self.components.T, target, rcond=None)[0], dtype=np.float64)

    def response(self, coefficients: npt.ArrayLike) -> Response:
        """Return the response with these coefficients."""
        values = np.array([float(c) for c in np.asarray(coefficients)])
        table = np.interp(np.linspace(0, 1, 256), self.curve(values), np.linspace(0, 1, RESPONSE_SAMPLES))
        return Response.from_values(_increasing(table), model={"name": "emor", "coefficients": values.tolist()})


@cache
def learned_model() -> ResponseModel:
    """Return a model learned from analytic families of curves."""
    curves = np.array(list(_family()))
    mean = curves.mean(axis=0)
    _, _, directions = np.linalg.svd(curves - mean, full_matrices=False)
    return ResponseModel(read_only(mean), read_only(directions[:RESPONSE_COMPONENTS] * np.sqrt(len(curves))))


def family_of_inverses(levels: int) -> FloatArray:
    """Return g for every curve that the model is learned from, at equidistant grey levels, shape (n, levels)."""
    grey, x = np.linspace(0, 1, levels), np.linspace(0, 1, RESPONSE_SAMPLES)
    return np.array([np.interp(grey, _increasing(curve), x) for curve in _family()])


def _family() -> list[FloatArray]:
    """Return the curves that the model is learned from, at equidistant irradiances, shape (1024,) each."""
    x = np.linspace(0, 1, RESPONSE_SAMPLES)
    curves = [x ** (1 / g) for g in np.geomspace(*FAMILY_GAMMAS)]
    for g in np.geomspace(*FAMILY_TOE_GAMMAS):
        for toe in FAMILY_TOES:
            # A straight line up to the toe, continued by a power with the same value and slope.
            offset = toe * (g - 1)
            power = (np.maximum(x, toe) + offset) ** (1 / g)
            at_toe = (toe + offset) ** (1 / g)
            curves.append(_unit(np.where(x < toe, at_toe * x / toe, power)))
    curves += [np.log1p(a * x) / np.log1p(a) for a in np.geomspace(*FAMILY_LOGARITHMS)]
    for p in FAMILY_SIGMOID_POWERS:
        curves += [(1 + c) * x**p / (x**p + c) for c in np.geomspace(*FAMILY_SIGMOID_MIDDLES)]
    bases = list(curves)
    for knee_x, knee_y in FAMILY_KNEES:
        knee = np.interp(x, [0, knee_x, 1], [0, knee_y, 1])
        curves.append(knee)
        curves += [_unit(0.5 * knee + 0.5 * base) for base in bases[::EVERY_WITH_KNEE]]
    return curves


def _unit(curve: FloatArray) -> FloatArray:
    return np.asarray((curve - curve[0]) / (curve[-1] - curve[0]))


def _increasing(curve: FloatArray) -> FloatArray:
    """Return the curve, forced to increase strictly, and scaled to 0 to 1."""
    steps = np.maximum(np.diff(curve), MIN_RESPONSE_SLOPE / len(curve))
    raised = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(raised / raised[-1])
