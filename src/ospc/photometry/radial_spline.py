"""Functions of R² that are zero at R = 0 and whose slope is linear between knots: quadratic splines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class RadialSpline:
    """A space of such functions, each given by its slopes d/d(R²) at the knots.

    The knots are equidistant in R², so each covers the same area of the image. Beyond the last knot the slope is
    constant.

    Attributes
    ----------
    terms
        Number of knots; without any, the only function is zero.
    reach
        Radius of the last knot.
    """

    terms: int
    reach: float

    @cached_property
    def knots(self) -> FloatArray:
        """R² of the knots, shape (terms,)."""
        return np.asarray(np.arange(self.terms) * self.spacing)

    def values(self, slopes: FloatArray, squared: FloatArray) -> FloatArray:
        """Return the values at R², any shape, given the slopes, shape (terms,)."""
        if not self.terms:
            return np.zeros_like(squared)
        at_knots = np.concatenate([[0.0], np.cumsum((slopes[1:] + slopes[:-1]) / 2) * self.spacing])
        lower, upper, by_lower, by_upper = self._within_interval(squared)
        return np.asarray(at_knots[lower] + slopes[lower] * by_lower + slopes[upper] * by_upper)

    def slope(self, slopes: FloatArray, squared: FloatArray) -> FloatArray:
        """Return the derivative by R² at R², any shape, given the slopes at the knots, shape (terms,)."""
        return np.asarray(np.interp(squared, self.knots, slopes)) if self.terms else np.zeros_like(squared)

    def jacobian(self, squared: FloatArray) -> FloatArray:
        """Return the derivative of the values at R² by the slopes at the knots, shape (n,) -> (n, terms)."""
        if not self.terms:
            return np.zeros((len(squared), 0))
        lower, upper, by_lower, by_upper = self._within_interval(squared)
        rows, found = np.arange(len(squared)), self._at_knots[lower]
        found[rows, lower] += by_lower
        found[rows, upper] += by_upper
        return found

    def slopes_at(self, squared: FloatArray) -> FloatArray:
        """Return the derivative of the slope at R² by the slopes at the knots, shape (n,) -> (n, terms)."""
        weights = [np.interp(squared, self.knots, one) for one in np.eye(self.terms)]
        return np.reshape(weights, (self.terms, len(squared))).T

    @property
    def spacing(self) -> float:
        """Distance between neighbouring knots, in R²."""
        return self.reach**2 / max(self.terms - 1, 1)

    @cached_property
    def _at_knots(self) -> FloatArray:
        """Derivative of the values at the knots by the slopes, shape (terms, terms)."""
        eye = np.eye(self.terms)
        return np.concatenate([0 * eye[:1], np.cumsum((eye[1:] + eye[:-1]) / 2, axis=0) * self.spacing])

    def _within_interval(self, squared: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return the knots below and above R², and the integral of either one's weight from the lower knot to R²."""
        place = squared / self.spacing
        lower = np.minimum(place, max(self.terms - 2, 0)).astype(np.int64)
        upper = np.minimum(lower + 1, self.terms - 1)
        offset = place - lower
        inside = np.minimum(offset, 1.0)
        by_upper = inside**2 / 2
        by_lower = inside - by_upper
        return lower, upper, by_lower * self.spacing, (by_upper + offset - inside) * self.spacing
