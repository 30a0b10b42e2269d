"""The uncertainty of a fitted vignette in images of one size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.numerics.symmetric import eigh, variances
from ospc.photometry.geometry import along_diagonals
from ospc.settings.fit import CONFIDENCE, ERROR_DRAWS, PROFILE_POINTS


@dataclass(frozen=True)
class VignetteErrors:
    """The uncertainty of a fitted vignette along the half diagonals of an image.

    For a decentred or non-radial vignette, the errors differ between the half diagonals.
    """

    basis: VignetteBasis
    """Basis of the fitted vignette."""
    parameters: FloatArray
    """Its parameters, shape (p,)."""
    covariance: FloatArray
    """Covariance of these parameters in total, shape (p, p)."""
    chance: FloatArray
    """The part of it due to chance alone, shape (p, p)."""
    measured_radius: float
    """Distance of the last observations from the centre of the vignette, in half diagonals."""
    size: ImageSize
    """Width and height of the image in pixels."""

    def worst_log_sigma(self, radius: float) -> float:
        """Return the largest standard deviation of ln V at a radius in half diagonals."""
        return float(np.sqrt(self._total_log_variance(np.array([radius])).max()))

    def largest_correction(self, radius: float) -> float:
        """Return the largest |ln V| at a radius in half diagonals."""
        return float(np.abs(np.log(self._value(np.array([radius])))).max())

    def sigma(self, radius: FloatArray) -> FloatArray:
        """Return the root mean square standard deviation of V at radii in half diagonals, shape (n,) -> (n,).

        Beyond the usable radius, V is unknown: any value from 0 to that at this radius is equally likely.
        """
        usable, along = self.basis.usable_vignette(self.parameters, self.size), self._along(radius)
        beyond = np.linalg.norm(along - usable.centre, axis=1).reshape(-1, 4) > usable.limit
        known = self._value(radius) ** 2 * self._total_log_variance(radius)
        unknown = usable.at_normalised(along).reshape(-1, 4) ** 2 / 3
        variance = np.where(beyond, unknown, known)
        return np.asarray(np.sqrt(variance.mean(axis=1)))

    def bound(self, radius: float) -> float:
        """Return the root mean square error of V up to a radius that is exceeded in 5 % of cases.

        It is taken along the half diagonals, not of their mean, in which the errors of a tilt cancel.
        """
        radii = np.linspace(0, radius, PROFILE_POINTS)
        value = self._value(radii).ravel()
        slope = self._jacobian(radii) * value[:, None]
        drawn = drawn_errors(slope, self._covariance_with_unseen, np.random.default_rng(0))
        unresolved = value * self._unresolved(radii).ravel()
        return float(np.quantile(np.sqrt(np.mean(drawn**2, axis=0) + np.mean(unresolved**2)), CONFIDENCE))

    @property
    def sigma_at_corner(self) -> float:
        """Standard deviation of V at the corners that more samples can reduce, which excludes unseen bends."""
        return self._sigma_at_corner(self.covariance)

    @property
    def chance_sigma_at_corner(self) -> float:
        """The random part of :attr:`sigma_at_corner`, which decreases with more samples."""
        return self._sigma_at_corner(self.chance)

    def _sigma_at_corner(self, covariance: FloatArray) -> float:
        corner = np.ones(1)
        return float(np.sqrt(np.mean(self._value(corner) ** 2 * self._log_variance(corner, covariance))))

    @cached_property
    def _covariance_with_unseen(self) -> FloatArray:
        """Covariance of the parameters with bends of the vignette beyond the last observations, shape (p, p)."""
        return self.covariance + self.basis.unseen(self.parameters, self.measured_radius)

    def _total_log_variance(self, radius: FloatArray) -> FloatArray:
        """Return the variance of ln V with bends between knots and beyond the last observations, shape (n, 4)."""
        return self._log_variance(radius, self._covariance_with_unseen) + self._unresolved(radius) ** 2

    def _log_variance(self, radius: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return the variance of ln V due to the parameters at radii along the half diagonals, shape (n, 4)."""
        rows = self._jacobian(radius)
        return variances(rows, covariance).reshape(-1, 4)

    def _value(self, radius: FloatArray) -> FloatArray:
        """Return V at radii along the half diagonals, shape (n, 4)."""
        return np.exp(self.basis.log_value(self.parameters, self._along(radius))).reshape(-1, 4)

    def _jacobian(self, radius: FloatArray) -> FloatArray:
        """Return the derivatives of ln V with respect to the parameters along the half diagonals, shape (4 n, p)."""
        return self.basis.jacobian(self.parameters, self._along(radius))

    def _unresolved(self, radius: FloatArray) -> FloatArray:
        """Return the standard deviation of ln V due to bends between knots, shape (n, 4)."""
        return self.basis.unresolved(self.parameters, self._along(radius)).reshape(-1, 4)

    def _along(self, radius: FloatArray) -> FloatArray:
        return along_diagonals(radius, self.size).reshape(-1, 2)


def drawn_errors(rows: FloatArray, covariance: FloatArray, random: np.random.Generator) -> FloatArray:
    """Draw errors of n values, given their derivatives with respect to the parameters, shape (n, draws)."""
    values, vectors = eigh(covariance)
    drawn = vectors @ (np.sqrt(np.maximum(values, 0))[:, None] * random.normal(size=(len(values), ERROR_DRAWS)))
    return np.asarray(rows @ drawn)
