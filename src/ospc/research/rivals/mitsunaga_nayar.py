"""Mitsunaga and Nayar, "Radiometric self calibration", 1999.

g(M) = Σ cₙMⁿ with g(1) = 1. For successive images with exposure ratio R, g(M₁) − R·g(M₂) = 0 is linear in the
coefficients; the ratios can be refined in turn, R = mean of g(M₁)/g(M₂).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.errors import NotObservableError, SettingError
from ospc.photometry.response import Response
from ospc.research.rivals.exposure_series import LEVELS, ExposureSeries, response_of_values

_MOST_DEGREES = 10
_EXPOSED = (2, 253)
"""Grey levels between which pixels are used."""

_FEWEST_PIXELS = 50
_SETTLED = 1e-6
"""Change of the coefficients at which turns end."""

_LEAST_IRRADIANCE = 1e-3
"""Values of g that ratios are computed from; smaller ones are mostly noise."""


@dataclass(frozen=True)
class MitsunagaNayar:
    """The result of radiometric self calibration.

    Attributes
    ----------
    coefficients
        c₀ … c_N of g(M) = Σ cₙMⁿ.
    ratios
        Exposure of each image over that of the next, shape (n − 1,).
    error
        Root mean square of g(M₁) − R·g(M₂).
    """

    coefficients: FloatArray
    ratios: FloatArray
    error: float

    @property
    def response(self) -> Response:
        """The polynomial as a response."""
        levels = np.linspace(0, 1, LEVELS)
        values = np.polynomial.polynomial.polyval(levels, self.coefficients)
        return response_of_values(np.asarray(values - values[0]), "mitsunaga-nayar")


def mitsunaga_nayar(
    series: ExposureSeries,
    *,
    degree: int | None = None,
    samples: int = 2000,
    refine_ratios: bool = False,
    iterations: int = 100,
) -> MitsunagaNayar:
    """Return the response, and exposure ratios.

    Parameters
    ----------
    series
        The images.
    degree
        Degree of the polynomial; that of 1 to 10 with the least error where None, as the publication selects it.
    samples
        Number of pixels used.
    refine_ratios
        Whether exposure ratios are estimated in turn with the response, from those given. The publication does so
        for ratios that are known roughly; response and ratios then are known up to an exponent only.
    iterations
        Number of turns at most.

    Raises
    ------
    SettingError
        If the degree is not between 1 and 10.
    NotObservableError
        If too few pixels are exposed in two successive images.
    """
    if degree is not None and not 1 <= degree <= _MOST_DEGREES:
        raise SettingError(f"the degree of the polynomial is {degree}; choose one from 1 to {_MOST_DEGREES}")
    grey = series.sampled(samples).astype(np.float64)
    exposed = (grey > _EXPOSED[0]) & (grey < _EXPOSED[1])
    pairs = exposed[:-1] & exposed[1:]
    if np.count_nonzero(pairs) < _FEWEST_PIXELS:
        raise NotObservableError("hardly any pixel is exposed in two successive images; take smaller steps")
    first, second = grey[:-1] / 255, grey[1:] / 255
    start = series.exposures_ms[:-1] / series.exposures_ms[1:]
    degrees = range(1, _MOST_DEGREES + 1) if degree is None else (degree,)
    turns = iterations if refine_ratios else 1
    found = [_polynomial((first, second), pairs, start, n, turns) for n in degrees]
    return min(found, key=lambda result: result.error)


def _polynomial(
    grey: tuple[FloatArray, FloatArray], pairs: BoolArray, ratios: FloatArray, degree: int, turns: int
) -> MitsunagaNayar:
    """Solve for c₀ … c_{N−1} with c_N = 1 − Σ c, then for the ratios, until neither changes."""
    power = np.arange(degree + 1)
    image = np.nonzero(pairs)[0]
    a, b = (part[pairs][:, None] ** power for part in grey)
    previous: FloatArray | None = None
    coefficients = np.zeros(degree + 1)
    for _ in range(turns):
        d = a - ratios[image, None] * b
        free = np.linalg.lstsq(d[:, :-1] - d[:, -1:], -d[:, -1], rcond=None)[0]
        coefficients = np.append(free, 1 - free.sum())
        if previous is not None and np.max(np.abs(coefficients - previous)) < _SETTLED:
            break
        previous = coefficients
        if turns > 1:
            g1, g2 = a @ coefficients, b @ coefficients
            valid = (g1 > _LEAST_IRRADIANCE) & (g2 > _LEAST_IRRADIANCE)
            quotients = (g1 / np.maximum(g2, _LEAST_IRRADIANCE))[valid]
            totals = np.bincount(image[valid], weights=quotients, minlength=len(ratios))
            counts = np.bincount(image[valid], minlength=len(ratios))
            ratios = np.where(counts > 0, totals / np.maximum(counts, 1), ratios)
    d = a - ratios[image, None] * b
    return MitsunagaNayar(coefficients, ratios, float(np.sqrt(np.mean((d @ coefficients) ** 2))))
