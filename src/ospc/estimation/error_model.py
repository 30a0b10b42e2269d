"""How far a sampled grey level is from what the scene point should have given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from ospc.arrays import FloatArray, IntArray

_GREY_CELLS = 8
_GRADIENT_CELLS = 4
_MIN_PER_CELL = 40


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
    slip_px
        Standard deviation of the registration, in pixels of the image sampled.
    glint
        Standard deviation of the radiance itself, relative: surfaces are not quite Lambertian, light flickers.
    """

    constant: float = (0.5 / 255) ** 2
    shot: float = 0.0
    read: float = 0.0
    slip_px: float = 0.5
    glint: float = 0.005

    def variance(self, slope: FloatArray, irradiance: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the variance of each sighting's grey level, shape (n,).

        Parameters
        ----------
        slope
            dM/d ln e at the grey level expected, shape (n,).
        irradiance
            g there, shape (n,).
        gradient
            Grey gradient around the sample, shape (n,).
        """
        carried = slope**2 * ((self.read / irradiance + self.shot) / irradiance + self.glint**2)
        return np.asarray(self.constant + carried + (self.slip_px * gradient) ** 2)

    def refitted(
        self, squared: FloatArray, grey: FloatArray, slope: FloatArray, irradiance: FloatArray, gradient: FloatArray
    ) -> ErrorModel:
        """Return the model that fits squared residuals in grey levels, shape (n,), already freed of their leverage.

        Medians over cells of alike sightings are fitted, so outliers have no say.
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
        return ErrorModel(
            max(float(found[0]), (0.05 / 255) ** 2),
            float(found[1]),
            float(found[2]),
            float(np.sqrt(found[3])),
            max(float(np.sqrt(found[4])), 1e-4),
        )


def _quantile_index(values: FloatArray, cells: int) -> IntArray:
    edges = np.quantile(values, np.linspace(0, 1, cells + 1)[1:-1])
    return np.searchsorted(edges, values, side="right")
