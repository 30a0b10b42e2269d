"""The variance of a sampled grey level about the expected one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ospc.arrays import FloatArray, IntArray, count_reached
from ospc.numerics.least_squares import non_negative_least_squares
from ospc.numerics.robust import median
from ospc.settings.error_model import (
    FACTOR_GREYS,
    FACTOR_RANGE,
    GRADIENT_CELLS,
    GREY_CELLS,
    MEDIAN_OF_SQUARED_NORMAL,
    MIN_CELL_SIGMA,
    MIN_GREY_SIGMA,
    MIN_PER_CELL,
    MIN_RADIANCE_SIGMA,
    START_GREY_SIGMA,
    START_RADIANCE_SIGMA,
    START_REGISTRATION_SIGMA_PX,
)


@dataclass(frozen=True)
class ErrorModel:
    """Variance of a sampled grey level M, where s = dM/d ln e and g = g(M) is the irradiance.

    It is ``constant + shot · s²/g + read · s²/g² + registration² · gradient² + radiance² · s²``. Shot and read noise
    occur in irradiance; the slope of the response converts them to noise of the grey level.
    """

    constant: float = START_GREY_SIGMA**2
    """Variance of quantisation and other errors of the grey level itself, in full scale squared."""
    shot: float = 0.0
    """The part of the variance of the irradiance at white that is proportional to irradiance."""
    read: float = 0.0
    """The constant part of it."""
    registration_sigma_px: float = START_REGISTRATION_SIGMA_PX
    """Standard deviation of the registration, in pixels of the sampled image."""
    radiance_sigma: float = START_RADIANCE_SIGMA
    """Relative standard deviation of the radiance: surfaces are not exactly Lambertian, light flickers."""
    factors: tuple[float, ...] = ()
    """Factors on the sum at :data:`~ospc.settings.error_model.FACTOR_GREYS`, interpolated in between, which correct
    for its simplifications; empty for a factor of 1 everywhere."""
    gain_variances: tuple[float, ...] = ()
    """Variances of the latent gains of frames by :class:`~ospc.estimation.frame_gains.FrameGains`, in ln², which are
    not part of this variance; empty for none."""

    def variance(
        self, grey: FloatArray, slope: FloatArray, irradiance: FloatArray, gradient: FloatArray
    ) -> FloatArray:
        """Return the variance of each observation's grey level, shape (n,).

        Grey level, slope dM/d ln e and irradiance g are the expected ones; the gradient is that of the grey level
        around the sample, per pixel, shape (n,) each.
        """
        return self.with_gradient(*self.flat_variance(grey, slope, irradiance), gradient)

    def flat_variance(
        self, grey: FloatArray, slope: FloatArray, irradiance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the part that depends only on the grey level: the sum without the gradient, and its factor, (n,)."""
        carried = slope**2 * ((self.read / irradiance + self.shot) / irradiance + self.radiance_sigma**2)
        factor = np.exp(np.interp(grey, FACTOR_GREYS, np.log(self.factors))) if self.factors else np.ones_like(grey)
        return self.constant + carried, factor

    def with_gradient(self, flat: FloatArray, factor: FloatArray, gradient: FloatArray) -> FloatArray:
        """Return the variance, given the result of :meth:`flat_variance`, shape (n,) each."""
        return np.asarray((flat + (self.registration_sigma_px * gradient) ** 2) * factor)

    def refitted(
        self, squared: FloatArray, grey: FloatArray, slope: FloatArray, irradiance: FloatArray, gradient: FloatArray
    ) -> ErrorModel:
        """Return the model fitted to squared residuals in grey levels, shape (n,), corrected for their leverage.

        The fit uses medians over cells of similar grey level and gradient, so that outliers have no influence. The
        model is returned unchanged if too few cells contain enough observations.
        """
        over = slope**2 / irradiance
        regressors = np.stack([over, over / irradiance, gradient**2, slope**2])
        cell = _quantile_index(grey, GREY_CELLS) * GRADIENT_CELLS + _quantile_index(gradient, GRADIENT_CELLS)
        order, cells = _by_cell(cell, GREY_CELLS * GRADIENT_CELLS)
        by_cell, squared_by_cell = regressors[:, order], squared[order]
        rows, targets = [], []
        for inside in cells.values():
            variance = float(median(squared_by_cell[inside])) / MEDIAN_OF_SQUARED_NORMAL
            targets.append(max(variance, MIN_CELL_SIGMA**2))
            rows.append([1.0, *median(by_cell[:, inside])])
        if len(rows) <= len(regressors):
            return self
        relative = np.array(rows) / np.array(targets)[:, None]
        scale = np.maximum(relative.max(axis=0), 1e-300)
        found = non_negative_least_squares(relative / scale, np.ones(len(rows))) / scale
        law = ErrorModel(
            max(float(found[0]), MIN_GREY_SIGMA**2),
            float(found[1]),
            float(found[2]),
            float(np.sqrt(found[3])),
            max(float(np.sqrt(found[4])), MIN_RADIANCE_SIGMA),
        )
        factors = _factors(squared / law.variance(grey, slope, irradiance, gradient), grey)
        return replace(law, factors=factors, gain_variances=self.gain_variances)


def _by_cell(cell: IntArray, count: int) -> tuple[IntArray, dict[int, slice]]:
    """Return the order of observations by cell, and the slice of each cell that contains enough of them."""
    # NumPy sorts 16-bit integers with a radix sort.
    order = np.argsort(cell.astype(np.int16), kind="stable")
    bounds = np.searchsorted(cell[order], np.arange(count + 1)).tolist()
    found = {number: slice(*ends) for number, ends in enumerate(pairwise(bounds))}
    return order, {number: inside for number, inside in found.items() if inside.stop - inside.start >= MIN_PER_CELL}


def _factors(ratio: FloatArray, grey: FloatArray) -> tuple[float, ...]:
    """Return the ratio of squared residuals to the fitted variance around each of the grey levels of the factors."""
    greys = np.array(FACTOR_GREYS)
    edges = (greys[1:] + greys[:-1]) / 2
    order, near = _by_cell(np.searchsorted(edges, grey), len(greys))
    by_grey = ratio[order]
    factors = np.full(len(greys), np.nan)
    for number, inside in near.items():
        factors[number] = np.clip(median(by_grey[inside]) / MEDIAN_OF_SQUARED_NORMAL, *FACTOR_RANGE)
    known = np.isfinite(factors)
    if not known.any():
        return ()
    return tuple(np.interp(greys, greys[known], factors[known]).tolist())


def _quantile_index(values: FloatArray, cells: int) -> IntArray:
    """Return the index of the quantile range that contains each value, from 0 to ``cells`` − 1, shape (n,)."""
    edges = np.quantile(values, np.linspace(0, 1, cells + 1)[1:-1])
    return count_reached(edges, values)
