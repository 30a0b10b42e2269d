"""How far a sampled grey level is from what the scene point should have given."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from ospc.arrays import FloatArray, IntArray

_GREY_CELLS = 8
_GRADIENT_CELLS = 4
_MIN_PER_CELL = 40
_EXTREME_FACTORS = (0.25, 25.0)
_FACTOR_GREYS = np.array([0.0, 0.03, 0.08, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.91, 0.95, 0.975, 1.0])


@dataclass(frozen=True)
class ErrorModel:
    """Variance of a sampled grey level M, with s = dM/d ln e and irradiance g(M).

    ``constant + shot · s²/g + read · s²/g² + slip² · gradient² + glint² · s²``: photons and electronics make noise in
    irradiance, which the response's slope carries over to the grey level.

    Attributes
    ----------
    constant
        Variance of quantisation and whatever else happens to grey levels, in full scale squared.
    shot, read
        Variances of the irradiance at white that are proportional to it, and constant.
    registration_sigma_px
        Standard deviation of the registration, in pixels of the image sampled.
    radiance_sigma
        Standard deviation of the radiance itself, relative: surfaces are not quite Lambertian, light flickers.
    factors
        What the sum is multiplied by at certain grey levels, because cameras do more than this law knows; empty for
        one everywhere.
    """

    constant: float = (0.5 / 255) ** 2
    shot: float = 0.0
    read: float = 0.0
    registration_sigma_px: float = 0.5
    radiance_sigma: float = 0.005
    factors: tuple[float, ...] = ()

    def variance(
        self, grey: FloatArray, slope: FloatArray, irradiance: FloatArray, gradient: FloatArray
    ) -> FloatArray:
        """Return the variance of each observation's grey level, shape (n,).

        Parameters
        ----------
        grey
            Grey level expected, shape (n,).
        slope
            dM/d ln e at the grey level expected, shape (n,).
        irradiance
            g there, shape (n,).
        gradient
            Grey gradient around the sample, shape (n,).
        """
        carried = slope**2 * ((self.read / irradiance + self.shot) / irradiance + self.radiance_sigma**2)
        variance = self.constant + carried + (self.registration_sigma_px * gradient) ** 2
        if self.factors:
            variance = variance * np.exp(np.interp(grey, _FACTOR_GREYS, np.log(self.factors)))
        return np.asarray(variance)

    def refitted(
        self, squared: FloatArray, grey: FloatArray, slope: FloatArray, irradiance: FloatArray, gradient: FloatArray
    ) -> ErrorModel:
        """Return the model that fits squared residuals in grey levels, shape (n,), already freed of their leverage.

        Medians over cells of alike observations are fitted, so outliers have no say.
        """
        over = slope**2 / irradiance
        regressors = np.stack([np.ones_like(grey), over, over / irradiance, gradient**2, slope**2], axis=1)
        cell = _quantile_index(grey, _GREY_CELLS) * _GRADIENT_CELLS + _quantile_index(gradient, _GRADIENT_CELLS)
        rows, targets = [], []
        for number in range(_GREY_CELLS * _GRADIENT_CELLS):
            inside = np.flatnonzero(cell == number)
            if len(inside) >= _MIN_PER_CELL:
                # The median of a squared normal variate is 0.4549 of its variance.
                targets.append(max(float(np.median(squared[inside])) / 0.4549, (0.02 / 255) ** 2))
                rows.append(np.median(regressors[inside], axis=0))
        if len(rows) < regressors.shape[1]:
            return self
        relative = np.array(rows) / np.array(targets)[:, None]
        scale = np.maximum(relative.max(axis=0), 1e-300)
        found = nnls(relative / scale, np.ones(len(rows)))[0] / scale
        law = ErrorModel(
            max(float(found[0]), (0.05 / 255) ** 2),
            float(found[1]),
            float(found[2]),
            float(np.sqrt(found[3])),
            max(float(np.sqrt(found[4])), 1e-4),
        )
        return replace(law, factors=_factors(squared / law.variance(grey, slope, irradiance, gradient), grey))


def _factors(ratio: FloatArray, grey: FloatArray) -> tuple[float, ...]:
    """Return how much larger than the law squared residuals are around each of the grey levels of the factors."""
    edges = (_FACTOR_GREYS[1:] + _FACTOR_GREYS[:-1]) / 2
    near = np.searchsorted(edges, grey)
    factors = np.full(len(_FACTOR_GREYS), np.nan)
    for number in range(len(factors)):
        inside = ratio[near == number]
        if len(inside) >= _MIN_PER_CELL:
            factors[number] = np.clip(np.median(inside) / 0.4549, *_EXTREME_FACTORS)
    known = np.isfinite(factors)
    if not known.any():
        return ()
    return tuple(np.interp(_FACTOR_GREYS, _FACTOR_GREYS[known], factors[known]).tolist())


def _quantile_index(values: FloatArray, cells: int) -> IntArray:
    edges = np.quantile(values, np.linspace(0, 1, cells + 1)[1:-1])
    return np.searchsorted(edges, values, side="right")
