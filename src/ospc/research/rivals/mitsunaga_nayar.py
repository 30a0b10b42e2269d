"""Mitsunaga and Nayar, "Radiometric self calibration", 1999, with exposure ratios that are known.

g(M) = Σ cₙMⁿ with g(1) = 1. For successive images with exposure ratio R, g(M₀) − R·g(M₁) = 0 is linear in the
coefficients. The degree is the one with the least error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import NotObservableError, SettingError
from ospc.photometry.response import Response
from ospc.research.rivals.camera_at_rest import LEVELS, ExposureSeries, response_of_values

_MOST_DEGREES = 10
"""The highest degree that the publication tries."""

_EXPOSED = (2, 253)
"""Grey levels between which pixels are used."""

_PIXELS, _FEWEST_PIXELS = 2000, 50
"""Pixels that are used, and fewest of them that must be exposed in two successive images."""


@dataclass(frozen=True)
class MitsunagaNayar:
    """c₀ … c_N of g(M) = Σ cₙMⁿ, and the root mean square of g(M₀) − R·g(M₁)."""

    coefficients: FloatArray
    error: float

    @property
    def response(self) -> Response:
        """The polynomial as a response."""
        levels = np.linspace(0, 1, LEVELS)
        values = np.polynomial.polynomial.polyval(levels, self.coefficients)
        return response_of_values(np.asarray(values - values[0]), "mitsunaga-nayar")


def mitsunaga_nayar(series: ExposureSeries, degree: int | None = None) -> MitsunagaNayar:
    """Return the polynomial of a degree from 1 to 10; of the one with the least error where None."""
    if degree is not None and not 1 <= degree <= _MOST_DEGREES:
        raise SettingError(f"the degree of the polynomial is {degree}; choose one from 1 to {_MOST_DEGREES}")
    grey = series.sampled(_PIXELS).astype(np.float64)
    exposed = (grey > _EXPOSED[0]) & (grey < _EXPOSED[1])
    pairs = exposed[:-1] & exposed[1:]
    if np.count_nonzero(pairs) < _FEWEST_PIXELS:
        raise NotObservableError("hardly any pixel is exposed in two successive images; take smaller steps")
    ratio = (series.exposures_ms[:-1] / series.exposures_ms[1:])[np.nonzero(pairs)[0]]
    grey0, grey1 = grey[:-1][pairs] / 255, grey[1:][pairs] / 255
    degrees = range(1, _MOST_DEGREES + 1) if degree is None else (degree,)
    return min((_polynomial(grey0, grey1, ratio, n) for n in degrees), key=lambda result: result.error)


def _polynomial(grey0: FloatArray, grey1: FloatArray, ratio: FloatArray, degree: int) -> MitsunagaNayar:
    """Solve for c₀ … c_{N−1} with c_N = 1 − Σ c."""
    power = np.arange(degree + 1)
    d = grey0[:, None] ** power - ratio[:, None] * grey1[:, None] ** power
    free = np.linalg.lstsq(d[:, :-1] - d[:, -1:], -d[:, -1], rcond=None)[0]
    coefficients = np.append(free, 1 - free.sum())
    return MitsunagaNayar(coefficients, float(np.sqrt(np.mean((d @ coefficients) ** 2))))
