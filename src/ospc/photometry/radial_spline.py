"""Functions of R² that are zero at R = 0 and whose slope is linear between knots: quadratic splines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ospc.arrays import FloatArray, IntArray, count_reached

_KNOT_EXPONENT = 1.5
"""The knots are at equal steps of R² to the power of 1 / 1.5: closer in the middle than equal steps of R², where
vignettes of large apertures already bend, and closer at the edge than equal steps of R. Calibration files state only
the slopes at the knots, so it also defines their meaning."""
_KEPT_SPLINES = 64
"""Number of splines kept with their tables: several numbers of knots for each of several usable radii."""


@dataclass(frozen=True)
class RadialSpline:
    """A space of such functions, each given by its slopes d/d(R²) at the knots.

    The knots are at R = reach · (i / (terms − 1))^0.75. Beyond the last one the slope is constant.
    """

    terms: int
    """Number of knots; without any, the only function is zero."""
    reach: float
    """Radius of the last knot."""

    @cached_property
    def knots(self) -> FloatArray:
        """R² of the knots, shape (terms,)."""
        return np.asarray(self.reach**2 * (np.arange(self.terms) / max(self.terms - 1, 1)) ** _KNOT_EXPONENT)

    def values(self, slopes: FloatArray, squared: FloatArray) -> FloatArray:
        """Return the values at R², any shape, given the slopes, shape (terms,)."""
        if not self.terms:
            return np.zeros_like(squared)
        lower, upper, by_lower, by_upper = self._within_interval(squared)
        at_lower = (self._at_knots @ slopes).take(lower)
        return np.asarray(at_lower + slopes.take(lower) * by_lower + slopes.take(upper) * by_upper)

    def slope(self, slopes: FloatArray, squared: FloatArray) -> FloatArray:
        """Return the derivative with respect to R² at R², any shape, given the slopes, shape (terms,)."""
        return np.asarray(np.interp(squared, self.knots, slopes)) if self.terms else np.zeros_like(squared)

    def jacobian(self, squared: FloatArray) -> FloatArray:
        """Return the derivatives of the values at R² with respect to the slopes, shape (n,) -> (n, terms)."""
        if not self.terms:
            return np.zeros((len(squared), 0))
        lower, upper, by_lower, by_upper = self._within_interval(squared)
        # Indexing with an array would take twice as long.
        rows, found = np.arange(len(squared)), self._at_knots.take(lower, axis=0)
        found[rows, lower] += by_lower
        found[rows, upper] += by_upper
        return found

    def slopes_at(self, squared: FloatArray) -> FloatArray:
        """Return the derivatives of the slope at R² with respect to the knots' slopes, shape (n,) -> (n, terms)."""
        weights = [np.interp(squared, self.knots, one) for one in np.eye(self.terms)]
        return np.reshape(weights, (self.terms, len(squared))).T

    def width_at(self, squared: FloatArray) -> FloatArray:
        """Return the width in R² of the interval between knots that contains R², shape (n,) -> (n,)."""
        return self._widths.take(self._interval(squared))

    @cached_property
    def _widths(self) -> FloatArray:
        """Width of each interval in R², shape (max(terms - 1, 1),)."""
        return np.diff(self.knots) if self.terms > 1 else np.full(1, self.reach**2)

    @cached_property
    def _at_knots(self) -> FloatArray:
        """Derivative of the values at the knots with respect to the slopes, shape (terms, terms)."""
        eye = np.eye(self.terms)
        trapezia = (eye[1:] + eye[:-1]) / 2 * self._widths[: self.terms - 1, None]
        return np.concatenate([0 * eye[:1], np.cumsum(trapezia, axis=0)])

    def _interval(self, squared: FloatArray) -> IntArray:
        """Return the number of the interval that contains R², the last one beyond the last knot."""
        return count_reached(self.knots[1:-1], squared)

    def _within_interval(self, squared: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return the knots below and above R², and the integral of either one's weight from the lower knot to R²."""
        lower = self._interval(squared)
        upper, width = np.minimum(lower + 1, self.terms - 1), self._widths.take(lower)
        offset = (squared - self.knots.take(lower)) / width
        inside = np.minimum(offset, 1.0)
        by_upper = inside**2 / 2
        by_lower = inside - by_upper
        return lower, upper, by_lower * width, (by_upper + offset - inside) * width


@lru_cache(maxsize=_KEPT_SPLINES)
def radial_spline(terms: int, reach: float) -> RadialSpline:
    """Return a spline that is shared by all callers, because its tables take longer than a few values."""
    return RadialSpline(terms, reach)
