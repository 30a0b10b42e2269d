"""Predict the uncertainty of response and vignette, and how much another view would reduce it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.fit import Fit, measured_greys
from ospc.estimation.fitted import Fitted
from ospc.methods.preview import Preview
from ospc.numerics.symmetric import variances
from ospc.observations import ExposedObservations
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.vignette import usable_radius_of
from ospc.settings.live import ASSESSED_GREYS, EXPECTED_GRADIENT, EXPECTED_PAIR_POINTS, INFORMATION_POINTS

_DIAGONAL = np.ones(2) / np.sqrt(2)
"""Direction from the image centre to a corner of a square image, along which the vignette is assessed."""


@dataclass(frozen=True)
class Knowledge:
    """The current uncertainty of the parameters, linearised at a fit.

    Attributes
    ----------
    fit, covariance
        The fit at which the model is linearised, and the covariance of the parameters given all observations so far,
        shape (p, p).
    wanted
        Derivatives of g and V with respect to the parameters, one row per grey level and radius, shape (n, p).
    information_scale
        Share of its nominal information that an observation adds.
    response_sigma, vignette_sigma
        Standard deviations of g, with its scale fixed, and V, as root mean squares over grey levels and radii.
    """

    fit: Fit
    covariance: FloatArray
    wanted: FloatArray
    information_scale: float
    response_sigma: float
    vignette_sigma: float

    def corrected(self, response_sigma: float | None, vignette_sigma: float | None) -> Knowledge:
        """Return the knowledge with the standard deviations of a complete estimate where those are larger."""
        return replace(
            self,
            response_sigma=max(self.response_sigma, response_sigma or 0.0),
            vignette_sigma=max(self.vignette_sigma, vignette_sigma or 0.0),
        )

    def gain_of_exposure(self, grey0: float, grey1: float, goal: float) -> float:
        """Return the gain from a pair of frames in which points change from one grey level to another.

        The gain is the decrease of the sum of the squares of :attr:`response_sigma` and :attr:`vignette_sigma`, in
        units of the squared goal.
        """
        rows = self.fit.response_basis.log_rows([grey0, grey1])
        row = np.concatenate([rows[1] - rows[0], np.zeros(len(self.fit.vignette_basis))])
        return self._gain(row, (grey0, grey1), goal)

    def gain_of_motion(self, radius0: float, radius1: float, grey: float, goal: float) -> float:
        """Return the gain from a pair of frames in which points of a grey level move from one radius to another."""
        places = np.array([radius0, radius1])[:, None] * _DIAGONAL
        rows = self.fit.vignette_basis.jacobian(self.fit.vignette_parameters, places)
        row = np.concatenate([np.zeros(len(self.fit.response_basis)), rows[0] - rows[1]])
        return self._gain(row, (grey, grey), goal)

    def grey_after(self, grey: float, factor: float) -> float:
        """Return the grey level of a point after multiplying the exposure by a factor; 1 if it saturates."""
        grid, log_g = self.fit.response_basis.grid, self.fit.log_response
        return float(np.interp(np.interp(grey, grid, log_g) + np.log(factor), log_g, grid))

    def _gain(self, row: FloatArray, greys: tuple[float, float], goal: float) -> float:
        """Return the gain from one more row of the normal equations (Sherman and Morrison)."""
        variance = float(self._log_variance(np.array(greys)).sum())
        information = EXPECTED_PAIR_POINTS * self.information_scale / variance
        spread = self.covariance @ row
        falls = (self.wanted @ spread) ** 2 / (1 / information + row @ spread)
        response, vignette = np.mean(falls[: len(ASSESSED_GREYS)]), np.mean(falls[len(ASSESSED_GREYS) :])
        if (self.response_sigma <= goal) != (self.vignette_sigma <= goal):
            # Only the part that has not reached the goal counts.
            return float(response if self.response_sigma > goal else vignette) / goal**2
        return float(response + vignette) / goal**2

    def _log_variance(self, grey: FloatArray) -> FloatArray:
        """Return the variance of ln g of single samples at grey levels."""
        basis, parameters = self.fit.response_basis, self.fit.response_parameters
        grey = np.clip(grey, basis.grid[1], 1.0)
        slope = grey / np.interp(grey, basis.grid, basis.gamma_of(parameters))
        irradiance = np.maximum(np.exp(np.interp(grey, basis.grid, self.fit.log_response)), 1e-12)
        return self.fit.errors.variance(grey, slope, irradiance, np.full(len(grey), EXPECTED_GRADIENT)) / slope**2


def knowledge_of(preview: Preview | None) -> Knowledge | None:
    """Return the knowledge from all observations so far; None before the first fit."""
    if preview is None or preview.fit is None:
        return None
    fit, observations = preview.fit, preview.observations
    step = max(1, len(observations.starts) // INFORMATION_POINTS)
    covariance, scale = _covariance(fit, observations.of_points(slice(None, None, step)), step)
    wanted = _wanted(fit, sum(measured_greys(observations)) / 2, _radii(fit.vignette_basis.usable_radius))
    disagreement = np.maximum(variances(wanted, fit.covariance - fit.chance), 0)
    sigma = np.sqrt(variances(wanted, covariance) + disagreement)
    of_response, of_vignette = (_root_mean_square(part) for part in np.split(sigma, [len(ASSESSED_GREYS)]))
    return Knowledge(fit, covariance, wanted, scale, of_response, of_vignette)


def certainty(calibration: Calibration) -> tuple[float | None, float | None]:
    """Return the counterparts of :attr:`Knowledge.response_sigma` and ``vignette_sigma`` for a calibration.

    They are None for an unknown part. Radii beyond the usable part of the image do not count.
    """
    response, of_response, of_vignette = calibration.response, None, None
    if response is not None and response.inverse_sigma is not None:
        of_response = _root_mean_square(np.interp(ASSESSED_GREYS, response.levels, response.inverse_sigma))
    if calibration.vignette_sigma is not None:
        radii = _radii(usable_radius_of(calibration.vignette))
        of_vignette = _root_mean_square(calibration.vignette_sigma[: len(radii)])
    return of_response, of_vignette


def _covariance(fit: Fit, some: ExposedObservations, step: int) -> tuple[FloatArray, float]:
    equations = Fitted(fit, some, fit.pixel_noise).information(fit, fit.parameters)
    prior = fit.prior(fit.parameters).precision(fit.hyperparameters)
    information = step * equations.information_scale * equations.matrix + prior
    return np.asarray(np.linalg.inv(information), dtype=np.float64), equations.information_scale


def _radii(usable_radius: float) -> FloatArray:
    return PROFILE_RADII[usable_radius >= PROFILE_RADII]


def _wanted(fit: Fit, reference: float, radii: FloatArray) -> FloatArray:
    basis, vignette = fit.response_basis, fit.vignette_basis
    g = np.exp(np.interp(ASSESSED_GREYS, basis.grid, fit.log_response)) * (ASSESSED_GREYS > 0)
    response = g[:, None] * (basis.log_rows(ASSESSED_GREYS) - basis.log_rows([reference]))
    places = radii[:, None] * _DIAGONAL
    value = np.exp(vignette.log_value(fit.vignette_parameters, places))
    fall = value[:, None] * vignette.jacobian(fit.vignette_parameters, places)
    n = len(basis)
    return np.concatenate([np.pad(response, ((0, 0), (0, fall.shape[1]))), np.pad(fall, ((0, 0), (n, 0)))])


def _root_mean_square(sigma: FloatArray) -> float:
    return float(np.sqrt(np.mean(sigma**2)))
