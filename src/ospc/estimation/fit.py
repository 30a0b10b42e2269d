"""The result of fitting response and vignette, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, FloatArray, ImageSize
from ospc.estimation.effect_models import SCATTERED_LIGHT, AbsorbedLight
from ospc.estimation.effects import EffectTerms
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.mean_of_pixels import PixelMeans
from ospc.estimation.model import Model
from ospc.estimation.prior import PriorHyperparameters
from ospc.estimation.vignette_errors import VignetteErrors, drawn_errors
from ospc.numerics.symmetric import variances
from ospc.observations import ExposedObservations, Observations
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.noise import BRIGHTEST_EXPOSED, DARKEST_EXPOSED, NoiseModel
from ospc.photometry.response import Response
from ospc.photometry.verdict import EffectEstimate
from ospc.photometry.vignette import LogSplineVignette
from ospc.settings.fit import (
    CONFIDENCE,
    MAX_REFERENCE_UNRESOLVED,
    MAX_RESPONSE_LEVELS,
    MIN_RESPONSE_STEP,
    RATIO_BRIGHTEST_GREY,
    RATIO_DARKEST_GREY,
    RATIO_LEVELS,
    RATIO_LOG_GREY_SPREAD,
    RATIO_PARTNERS,
    SUPPORT_QUANTILES,
    UNSEEN_RESPONSE_CHANGE,
)
from ospc.settings.residuals import MAX_UNSTEADY_UNRESOLVED


@dataclass(frozen=True)
class Fit(Model):
    """A fitted model with the covariance of its parameters.

    Attributes
    ----------
    parameters
        Response coefficients, vignette parameters and effect parameters, in this order, shape (p,).
    covariance
        Covariance of the parameters, including disagreement between parts of the observations, shape (p, p).
    chance
        Covariance of the parameters due to chance alone, which decreases with more samples, shape (p, p).
    errors, hyperparameters
        Error model of the observations, and hyperparameters of the prior, as selected by the data.
    points, groups
        Number of scene points with at least one observation of non-zero weight, and number of groups of observations.
    pixel_noise
        Noise of the single pixels averaged in an observation; None if unknown.
    texture_share
        Share of the texture shift indicated by the observations.
    measured_radius
        Distance of the last observations from the centre of the vignette, in half diagonals.
    effect_estimates
        Estimates of all effects, included or not; empty if none were tried.
    """

    parameters: FloatArray
    covariance: FloatArray
    chance: FloatArray
    errors: ErrorModel
    hyperparameters: PriorHyperparameters
    points: int
    groups: int
    pixel_noise: NoiseModel | None = None
    texture_share: float = 0.0
    measured_radius: float = 1.0
    effect_estimates: tuple[EffectEstimate, ...] = ()

    @property
    def response_parameters(self) -> FloatArray:
        """Coefficients of the response basis, shape (len(response_basis),)."""
        return self.split(self.parameters)[0]

    @property
    def vignette_parameters(self) -> FloatArray:
        """Parameters of the vignette basis, shape (len(vignette_basis),)."""
        return self.split(self.parameters)[1]

    @property
    def effect_parameters(self) -> FloatArray:
        """Parameters of the effects, shape (len(effects),)."""
        return self.split(self.parameters)[2]

    def parameters_in(self, model: Model) -> FloatArray:
        """Convert the parameters to another model with the same response basis, shape (p,)."""
        vignette = model.vignette_basis.conversion(self.vignette_basis) @ self.vignette_parameters
        known = dict(zip(self.effects.chosen, self.effect_parameters, strict=True))
        effects = [known.get(effect, 0.0) for effect in model.effects.chosen]
        return np.concatenate([self.response_parameters, vignette, effects])

    @cached_property
    def log_response(self) -> FloatArray:
        """The logarithm of g on the response basis's grid."""
        return self.response_basis.log_of(self.response_parameters)

    def log_irradiance(self, observations: ExposedObservations) -> FloatArray:
        """Return ln e·L of observations, without vignette and additional light, shape (n,)."""
        log_irradiance = self._log_irradiance_with_added_light(observations)
        if not len(self.effects):
            return log_irradiance
        return log_irradiance - self.effects.log_added(self.effect_parameters, self._effect_terms(observations))

    def _log_irradiance_with_added_light(self, observations: ExposedObservations) -> FloatArray:
        log_g = np.interp(self.grey_of_mean(observations), self.response_basis.grid, self.log_response)
        return log_g - self.vignette_basis.log_value(self.vignette_parameters, observations.position)

    def grey_of_mean(self, observations: ExposedObservations) -> FloatArray:
        """Return the grey level of the mean irradiance of each observation's pixels, shape (n,)."""
        if self._pixel_means is None:
            return observations.grey
        index = self.response_basis.index_of(observations.grey)
        return self._pixel_means.at(observations, index).corrected(observations.grey, self.texture_share)

    @cached_property
    def _pixel_means(self) -> PixelMeans | None:
        if self.pixel_noise is None:
            return None
        return PixelMeans.of(self.response_basis, self.response_parameters, self.pixel_noise)

    def log_irradiance_rows(self, grey: FloatArray, position: FloatArray) -> FloatArray:
        """Return the derivative of :meth:`log_irradiance` with respect to both curves' parameters, shape (n, curves).

        Grey levels have shape (n,); positions relative to the image centre, in half diagonals, have shape (n, 2).
        """
        by_response = self.response_basis.log_table.take(self.response_basis.index_of(grey), axis=0)
        by_vignette = self.vignette_basis.jacobian(self.vignette_parameters, position)
        return np.concatenate([by_response, -by_vignette], axis=1)

    def log_radiance(self, observations: ExposedObservations) -> FloatArray:
        """Return ln L of observations, given their exposures, shape (n,)."""
        found = self._log_irradiance_with_added_light(observations) - observations.log_exposure
        if not len(self.effects):
            return found
        return found - self.effects.log_gain(self.effect_parameters, self._effect_terms(observations))

    def scattered_share(self, observations: ExposedObservations) -> FloatArray:
        """Return the scattered light in observations, relative to their irradiance in the response, shape (n,)."""
        effects = replace(self.effects, absorbed=AbsorbedLight())
        index = self.response_basis.index_of(observations.grey)
        terms = effects.terms(observations, self.response_tables(self.parameters), index)
        scattered = self.effect_parameters * np.isin(self.effects.chosen, SCATTERED_LIGHT)
        light = sum(value * terms.amounts[name] for name, value in zip(effects.chosen, scattered, strict=True))
        return np.asarray(light / terms.light)

    def log_exposure_error(self, observations: ExposedObservations) -> FloatArray:
        """Return ln of the true over the stated exposures, as far as it depends on them alone, shape (n,)."""
        if not len(self.effects):
            return np.zeros(len(observations))
        return self.effects.log_exposure_error(self.effect_parameters, self._effect_terms(observations))

    def residuals(self, observations: ExposedObservations) -> FloatArray:
        """Return the deviation of each observation's ln L from the mean of its point, shape (n,).

        The residual is NaN if the grey level is clipped or no other observation of the point is exposed.
        """
        log_radiance = self.log_radiance(observations)
        exposed = (observations.grey > DARKEST_EXPOSED) & (observations.grey < BRIGHTEST_EXPOSED)
        count = observations.combined(np.add, exposed.astype(np.float64))
        total = observations.combined(np.add, np.where(exposed, log_radiance, 0.0))
        mean = np.where(count > 1, total / np.maximum(count, 1), np.nan)
        return np.where(exposed, log_radiance - np.repeat(mean, observations.counts), np.nan)

    def resolves(self, observations: ExposedObservations) -> BoolArray:
        """Return for which observations the basis can follow the bends of the response, shape (n,)."""
        unresolved = self.response_basis.unresolved(self.response_parameters, observations.grey)
        return np.asarray(unresolved < MAX_UNSTEADY_UNRESOLVED)

    def _effect_terms(self, observations: ExposedObservations) -> EffectTerms:
        return self.effect_terms(self.parameters, observations, self.response_basis.index_of(observations.grey))

    def response(
        self, max_grey: int = 255, support: tuple[float, float] = (0.0, 1.0), grey_range: GreyRange = FULL_RANGE
    ) -> Response:
        """Return the response with its standard deviation.

        It has one level per grey value up to ``max_grey``, but at most 4096. ``support`` is the lowest and highest
        measured grey level, such as from :func:`measured_greys`. ``grey_range`` is the range to which the
        observations' grey levels were stretched.
        """
        levels = min(max_grey + 1, MAX_RESPONSE_LEVELS)
        unstretched = np.linspace(0, 1, levels)
        grey = grey_range.level(unstretched)
        table = np.exp(np.interp(grey, self.response_basis.grid, self.log_response))
        # A response must increase below black and above white, too.
        table, least = np.where(grey > 0, table, 0.0), np.arange(levels) * MIN_RESPONSE_STEP
        table = np.maximum(table, least) if grey_range.is_full else table + least
        reference_grey = self._reference_grey(unstretched, support, grey_range)
        reference, highest = (float(grey_range.level(level)) for level in (reference_grey, support[1]))
        model = {
            "name": "local gamma",
            "functions": self.response_basis.functions,
            "knots": self.response_basis.knots.tolist(),
            "coefficients": self.response_parameters.tolist(),
            "prior_walk": self.hyperparameters.walk,
            "prior_drift": self.hyperparameters.drift,
            "prior_knees": list(self.hyperparameters.knees),
        }
        if not grey_range.is_full:
            model["grey_range"] = [grey_range.black, grey_range.white]
        scale_sigma = np.hypot(self.log_response_step_sigma(1.0, reference), self._unseen_sigma(1.0, highest))
        return Response.from_values(
            table,
            log_sigma=np.hypot(self.log_response_sigma(grey, reference), self._unseen_sigma(grey, highest)),
            scale_sigma=float(scale_sigma),
            support=support,
            model=model,
            reference_grey=reference_grey,
        )

    def _reference_grey(self, levels: FloatArray, support: tuple[float, float], grey_range: GreyRange) -> float:
        """Return the middle of the measured range, or the nearest of the levels in it that is not at a sharp bend."""
        middle = sum(support) / 2
        possible = np.append(middle, levels[(levels >= support[0]) & (levels <= support[1])])
        unresolved = self.response_basis.unresolved(self.response_parameters, grey_range.level(possible))
        known = possible[unresolved <= max(MAX_REFERENCE_UNRESOLVED, unresolved.min())]
        return float(known[np.argmin(np.abs(known - middle))])

    def vignette(self, size: ImageSize) -> LogSplineVignette:
        """Return the vignette for an image size; beyond the observations it is extrapolated."""
        return self.vignette_basis.vignette(self.vignette_parameters, size)

    def usable_vignette(self, size: ImageSize) -> LogSplineVignette:
        """Return the vignette for an image size; beyond the usable radius of the images it is constant."""
        return self.vignette_basis.usable_vignette(self.vignette_parameters, size)

    def log_response_sigma(self, grey: FloatArray, reference: float) -> FloatArray:
        """Return the standard deviation of ln g(M)/g(reference) at grey levels M, shape (n,) -> (n,).

        It includes the errors at both levels from the limited resolution. Between two levels that are not resolved,
        these are partly the same.
        """
        n = len(self.response_basis)
        rows = self.response_basis.log_rows(grey) - self.response_basis.log_rows(np.array([reference]))
        variance = variances(rows, self.covariance[:n, :n])
        both = np.append(grey, reference)
        squared = self.response_basis.unresolved(self.response_parameters, both) ** 2
        apart = np.minimum(np.abs(both[:-1] - reference) * self.response_basis.resolved_intervals, 1.0)
        return np.asarray(np.sqrt(variance + apart * (squared[:-1] + squared[-1])))

    def log_response_step_sigma(self, low: float, high: float) -> float:
        """Return the standard deviation of ln g(high)/g(low)."""
        return float(self.log_response_sigma(np.array([high]), low)[0])

    def _unseen_sigma(self, grey: npt.ArrayLike, highest: float) -> FloatArray:
        """Return the standard deviation of ln g due to bends above the highest measured grey level, any shape."""
        gamma = self.response_basis.gamma_of(self.response_parameters)
        slope = np.interp(highest, self.response_basis.grid, gamma) / highest
        return np.asarray(UNSEEN_RESPONSE_CHANGE * slope * np.maximum(np.asarray(grey) - highest, 0.0))

    @cached_property
    def log_ratio_error_bound(self) -> float:
        """Error of irradiance ratios that is not exceeded with a probability of 95 %.

        The error is κ, the median error of ln g(a)/g(b) over pairs of grey levels, as computed by
        :func:`ospc.evaluation.metrics.log_ratio_error` when the truth is known.
        """
        random = np.random.default_rng(0)
        grey = np.linspace(RATIO_DARKEST_GREY, RATIO_BRIGHTEST_GREY, RATIO_LEVELS)
        other = grey * np.exp(random.normal(0, RATIO_LOG_GREY_SPREAD, (RATIO_PARTNERS, RATIO_LEVELS)))
        both = np.stack(np.broadcast_arrays(grey, np.clip(other, grey[0], grey[-1]))).reshape(2, -1)
        basis = self.response_basis
        rows = basis.log_rows(both[0]) - basis.log_rows(both[1])
        unresolved = np.hypot(*(basis.unresolved(self.response_parameters, levels) for levels in both))
        drawn = drawn_errors(rows, self.covariance[: len(basis), : len(basis)], random)
        drawn += unresolved[:, None] * random.normal(size=drawn.shape)
        return float(np.quantile(np.median(np.abs(drawn), axis=0), CONFIDENCE))

    def vignette_errors(self, size: ImageSize) -> VignetteErrors:
        """Return the uncertainty of the vignette for an image size."""
        part = self.vignette_part
        covariance, chance = self.covariance[part, part], self.chance[part, part]
        parameters, radius = self.vignette_parameters, self.measured_radius
        return VignetteErrors(self.vignette_basis, parameters, covariance, chance, radius, size)


def measured_greys(observations: Observations) -> tuple[float, float]:
    """Return the lowest and highest grey level, in [0, 1], at which observations measure the response."""
    low, high = np.quantile(observations.grey, SUPPORT_QUANTILES).tolist()
    return low, high
