"""How far a sampled grey level is from what the scene point should have given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from ospc.arrays import FloatArray
from ospc.correspondence.sightings import Sightings

_CELLS = 5
_MIN_PER_CELL = 40


@dataclass(frozen=True)
class ErrorModel:
    """Variance of a sampled grey level: constant + shot · M + slip² · gradient² + glint² · slope².

    Attributes
    ----------
    constant
        Variance of read noise and quantisation, in full scale squared.
    shot
        Growth of the variance with the grey level M.
    slip_px
        Standard deviation of the registration, in pixels of the image sampled.
    glint
        Standard deviation of the radiance itself, relative: surfaces are not quite Lambertian, light flickers.
    """

    constant: float = (0.5 / 255) ** 2
    shot: float = 0.0
    slip_px: float = 0.5
    glint: float = 0.005

    def variance(self, grey: FloatArray, slope: FloatArray, sightings: Sightings) -> FloatArray:
        """Return the variance of each sighting's grey level, shape (n,).

        Parameters
        ----------
        grey
            Grey level expected of each sighting, shape (n,).
        slope
            dM/d ln e there, shape (n,).
        sightings
            The sightings.
        """
        variance = self.constant + self.shot * grey + (self.glint * slope) ** 2
        return np.asarray(variance + (self.slip_px * sightings.gradient) ** 2)

    def refitted(self, squared: FloatArray, grey: FloatArray, slope: FloatArray, sightings: Sightings) -> ErrorModel:
        """Return the model that fits squared residuals in grey levels, shape (n,), already freed of their leverage.

        Medians over cells of alike sightings are fitted, so outliers have no say.
        """
        regressors = self._regressors(grey, slope, sightings)
        cell = _quantile_index(grey) * _CELLS + _quantile_index(sightings.gradient)
        rows, targets = [], []
        for number in range(_CELLS**2):
            inside = np.flatnonzero(cell == number)
            if len(inside) >= _MIN_PER_CELL:
                # The median of a squared normal variate is 0.4549 of its variance.
                targets.append(max(float(np.median(squared[inside])) / 0.4549, (0.02 / 255) ** 2))
                rows.append(regressors[inside].mean(axis=0))
        if len(rows) < regressors.shape[1]:
            return self
        relative = np.array(rows) / np.array(targets)[:, None]
        scale = relative.max(axis=0)
        scale[scale == 0] = 1
        found = nnls(relative / scale, np.ones(len(rows)))[0] / scale
        return ErrorModel(
            max(float(found[0]), (0.05 / 255) ** 2),
            float(found[1]),
            float(np.sqrt(found[2])),
            max(float(np.sqrt(found[3])), 1e-4),
        )

    @staticmethod
    def _regressors(grey: FloatArray, slope: FloatArray, sightings: Sightings) -> FloatArray:
        return np.stack([np.ones_like(grey), np.clip(grey, 0, 1), sightings.gradient**2, slope**2], axis=1)


def _quantile_index(values: FloatArray) -> FloatArray:
    edges = np.quantile(values, np.linspace(0, 1, _CELLS + 1)[1:-1])
    return np.asarray(np.searchsorted(edges, values, side="right"))
