"""Prediction errors of a new pair of frames, and the camera change that explains them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.fit import Fit
from ospc.numerics.robust import median
from ospc.observations import ExposedObservations
from ospc.settings.effects import DARKEST_IRRADIANCE
from ospc.settings.error_model import DARKEST_GREY
from ospc.settings.methods import (
    CHANGE_GREY_KNOTS,
    NO_CHANGE_POINTS,
    OUTLIER_ERROR_LOG,
    SEEN_QUANTILES,
    SYSTEMATIC_LOG,
)

RESPONSE_PARAMETERS = len(CHANGE_GREY_KNOTS) + 1
PARTS = {
    "response": slice(0, RESPONSE_PARAMETERS),
    "vignette": slice(RESPONSE_PARAMETERS, RESPONSE_PARAMETERS + 4),
}
"""Parameters of a change: a relative change of ln g and one at each knot; the coefficients of R², R⁴, x and y in
ln V, because a lens may also move sideways."""

_STEPS = np.linspace(0, 1, 21)
"""Points at which the effect of a change is evaluated, relative to the observed range of grey levels or radii."""


@dataclass(frozen=True)
class PairErrors:
    """The errors ρ of a pair's scene points: ln of the measured over the predicted ratio of irradiances.

    A change x of the camera adds Φ x to them, and an error δ of the fit's curves subtracts X δ. Pairs are
    described by sums over their scene points, after subtraction of the mean over the pair, so changes of light that
    affect all points equally have no influence. Glare adds the same light to all points of a frame, and more to ln of
    the irradiance of dark points; what it may explain is subtracted only from the sums named after it.
    """

    frame0: int
    frame1: int
    """Numbers of the frames."""
    points: int
    """Number of scene points n."""
    matrix: FloatArray
    """ΦᵀΦ, shape (11, 11)."""
    vector: FloatArray
    """Φᵀρ, shape (11,)."""
    matrix_beyond_light: FloatArray
    """ΦᵀΦ without what light added to either frame, the same for all its points, may explain, shape (11, 11)."""
    vector_beyond_light: FloatArray
    """Φᵀρ without it, shape (11,)."""
    fit_products: FloatArray
    """ΦᵀX, shape (11, p)."""
    error: float
    """Median of ρ over the whole pair."""
    common: FloatArray
    """Mean of Φ, by which a change shifts this median, shape (11,)."""
    max_radius: float
    """Radius in half diagonals that includes nearly all observations."""
    grey_limits: FloatArray
    """Lowest and highest grey level that include nearly all observations."""

    @classmethod
    def of(cls, seen: ExposedObservations, fit: Fit) -> PairErrors:
        """Compare a pair of frames, with each scene point observed once in both, with a fit."""
        basis, log_g = fit.response_basis, fit.log_response
        log_radiance = fit.log_radiance(seen)
        log_gain = np.interp(fit.grey_of_mean(seen), basis.grid, log_g) - log_radiance
        error = log_radiance[1::2] - log_radiance[0::2]
        middle = float(median(error))
        # The basis is evaluated at the grey levels predicted from both observations: at the measured ones, its noise
        # would be correlated with the errors, and every pair of nearly equal exposures would seem to have changed.
        # Light that changed for all points is known: without it, the levels of a shaded frame would be far off.
        mean_radiance = np.repeat((log_radiance[0::2] + log_radiance[1::2]) / 2, 2)
        predicted = mean_radiance + np.tile([-middle / 2, middle / 2], len(error)) + log_gain
        grey = np.interp(predicted, log_g, basis.grid)
        rows = fit.log_irradiance_rows(grey, seen.position)
        squared = np.sum(seen.position**2, axis=1)
        hats = np.stack([np.interp(grey, CHANGE_GREY_KNOTS, row) for row in np.eye(len(CHANGE_GREY_KNOTS))], axis=1)
        columns = np.column_stack([-np.interp(grey, basis.grid, log_g), -hats, squared, squared**2, seen.position])
        # The second observation of each point minus the first.
        change, parameter = (values[1::2] - values[0::2] for values in (columns, -rows))
        light = np.array([-1.0, 1.0]) * np.exp(-np.maximum(predicted, np.log(DARKEST_IRRADIANCE))).reshape(-1, 2)
        # Relative to the median, so that an error common to the pair keeps full weight however large it is.
        weight = (1 / (1 + ((error - middle) / OUTLIER_ERROR_LOG) ** 2))[:, None]
        root = np.sqrt(weight)

        def mean(values: FloatArray) -> FloatArray:
            return np.asarray(np.sum(weight * values, axis=0) / weight.sum())

        def centred(values: FloatArray) -> FloatArray:
            return np.asarray(root * (values - mean(values)))

        phi, rho, x = centred(change), centred(error[:, None])[:, 0], centred(parameter)
        by_light, _ = np.linalg.qr(centred(light))
        phi_beyond = phi - by_light @ (by_light.T @ phi)
        return cls(
            frame0=int(seen.frame[0]),
            frame1=int(seen.frame[1]),
            points=len(error),
            matrix=phi.T @ phi,
            vector=phi.T @ rho,
            matrix_beyond_light=phi_beyond.T @ phi_beyond,
            vector_beyond_light=phi_beyond.T @ rho,
            fit_products=phi.T @ x,
            error=middle,
            common=mean(change),
            max_radius=float(np.sqrt(np.quantile(squared, SEEN_QUANTILES[1]))),
            grey_limits=np.quantile(grey, SEEN_QUANTILES),
        )

    @property
    def consecutive(self) -> bool:
        """Whether the frames are consecutive."""
        return self.frame1 == self.frame0 + 1

    @property
    def effect(self) -> float:
        """Root mean square error that a change of the camera could explain, in ln."""
        change = np.linalg.solve(self.matrix + NO_CHANGE_POINTS * np.eye(len(self.vector)), self.vector)
        return float(np.sqrt(max(float(self.vector @ change), 0.0) / self.points))

    def energy(self, change: FloatArray) -> float:
        """Return the sum of squared errors caused by a change of the camera."""
        return float(change @ self.matrix @ change)

    def gain(self, change: FloatArray) -> float:
        """Return the reduction of the sum of squared errors by a change of the camera."""
        return float(2 * change @ self.vector) - self.energy(change)


@dataclass(frozen=True)
class ExplainedChange:
    """The change of response or vignette, zero in the other part, that best explains the errors of pairs."""

    part: str
    """The part that changed: ``"response"`` or ``"vignette"``."""
    change: FloatArray
    """The change, shape (11,)."""
    covariance: FloatArray
    """Covariance of the part's parameters, from the scatter between pairs and the uncertainty of the fit."""
    gain: float
    """Reduction of the sum of squared errors."""
    share_beyond_light: float
    """Reduction by any change of the part beyond that by light added to frames, relative to the gain."""
    max_radius: float
    """Radius of the pairs' observations."""
    grey_limits: FloatArray
    """Range of grey levels of the pairs' observations."""

    @classmethod
    def of(cls, pairs: list[PairErrors], fit: Fit, part: str) -> ExplainedChange:
        """Explain pairs by a change of one part; the covariance includes a systematic error of each parameter."""
        own = PARTS[part]
        inverse, found = _least_squares([(pair.matrix[own, own], pair.vector[own]) for pair in pairs])
        scores = np.stack([pair.vector[own] - pair.matrix[own, own] @ found for pair in pairs])
        by_fit = inverse @ np.sum([pair.fit_products[own] for pair in pairs], axis=0)
        curves = slice(fit.vignette_part.stop)
        covariance = inverse @ (scores.T @ scores) @ inverse + by_fit @ fit.chance[curves, curves] @ by_fit.T
        # The ridge keeps unobserved changes at zero, so it adds nothing to the covariance.
        covariance += SYSTEMATIC_LOG**2 * np.eye(len(found))
        change = np.zeros(len(pairs[0].vector))
        change[own] = found
        gain = sum(pair.gain(change) for pair in pairs)
        beyond_light = [(pair.matrix_beyond_light[own, own], pair.vector_beyond_light[own]) for pair in pairs]
        _, found_beyond = _least_squares(beyond_light)
        gain_beyond = float(found_beyond @ np.sum([vector for _, vector in beyond_light], axis=0))
        share = gain_beyond / gain if gain > 0 else 0.0
        max_radius = float(np.median([pair.max_radius for pair in pairs]))
        grey_limits = np.median([pair.grey_limits for pair in pairs], axis=0)
        return cls(part, change, covariance, gain, share, max_radius, grey_limits)

    @property
    def sigmas(self) -> float:
        """Distance from zero in standard deviations (Mahalanobis distance)."""
        found = self.change[PARTS[self.part]]
        return float(np.sqrt(found @ np.linalg.solve(self.covariance, found)))

    @property
    def curve(self) -> FloatArray:
        """The change of ln V over the observed radii, or of ln g over the observed grey levels minus its median.

        That of ln V is evaluated to the right, downwards, to the left and upwards.
        """
        found = self.change[PARTS[self.part]]
        if self.part == "vignette":
            radius, sideways = self.max_radius * _STEPS[:, None], np.concatenate([found[2:], -found[2:]])
            return np.ravel(found[0] * radius**2 + found[1] * radius**4 + radius * sideways)
        grey = np.maximum(np.interp(_STEPS, (0, 1), self.grey_limits), DARKEST_GREY)
        values = found[0] * np.log(grey) + np.interp(grey, CHANGE_GREY_KNOTS, found[1:])
        return np.asarray(values - np.median(values))

    @property
    def effect(self) -> float:
        """Largest value of the curve, with its sign."""
        return float(self.curve[np.argmax(np.abs(self.curve))])


def _least_squares(equations: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return the inverse of the summed matrices, with the prior that nothing changed, and the solution."""
    matrices, vectors = zip(*equations, strict=True)
    inverse = np.linalg.inv(np.sum(matrices, axis=0) + NO_CHANGE_POINTS * np.eye(len(vectors[0])))
    return inverse, inverse @ np.sum(vectors, axis=0)
