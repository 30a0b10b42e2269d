"""Summary of a run as a calibration: curves with their uncertainty, verdicts, exposure ratios and advice."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray, ImageSize, IntArray
from ospc.errors import counted
from ospc.estimation.fit import Fit, measured_greys
from ospc.methods.contradictions import contradictions_of
from ospc.methods.corrections import notes_of
from ospc.methods.coverage import coverage_of
from ospc.methods.identifiability import (
    response_verdict,
    unexplained_share,
    vignette_verdict,
)
from ospc.observations import ExposedObservations
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.noise import BRIGHTEST_EXPOSED, DARKEST_EXPOSED, NoiseModel
from ospc.photometry.verdict import EffectEstimate
from ospc.robust import SIGMA_OF_MEDIAN, medians
from ospc.settings import DefaultSettings
from ospc.settings.methods import CONTRADICTING_UNEXPLAINED_SHARE
from ospc.settings.residuals import MISREGISTERED_SIGMAS, MISREGISTERED_SPREAD

_INTER_CODED = (
    "inter-frame compression of the video loses small changes of brightness, so all standard deviations are doubled; "
    "record images or MJPEG for more accuracy"
)

_MISREGISTERED = (
    "not used: {pairs} of frames whose points disagree with each other, usually because of repetitive texture, which "
    "is registered wrongly, or reflections"
)

_OVERLAY = (
    "{share:.2g} % of the image shows something fixed to the camera, such as an overlay or part of the vehicle, and "
    "is not used"
)


@dataclass(frozen=True)
class FitInputs:
    """The data of calibrations, summaries and reports.

    Attributes
    ----------
    size, max_grey
        Size in pixels and largest grey value of the frames.
    noise
        Noise of single pixels.
    observations, fit
        The observations with their exposures, stretched to the grey range, and the fit to them; None if there are
        none or they do not allow a fit.
    standing_still
        Whether the camera was stationary: each observation is then a single pixel instead of a mean of several.
    pairs
        Number of pairs of frames registered.
    grey_range
        Grey levels of black and white.
    inter_coded
        Whether the frames come from a video with inter-frame compression, see :data:`INTER_CODED_SIGMAS`.
    overlay_share
        Share of the image that shows something fixed to the camera, which is not used.
    misregistered
        Number of pairs of frames that were registered wrongly, whose observations are left out.
    """

    size: ImageSize
    max_grey: int
    noise: NoiseModel
    observations: ExposedObservations | None
    fit: Fit | None
    standing_still: bool
    pairs: int
    grey_range: GreyRange = FULL_RANGE
    inter_coded: bool = False
    overlay_share: float = 0.0
    misregistered: int = 0

    @property
    def effects(self) -> tuple[EffectEstimate, ...]:
        """The estimates of effects other than response and vignette; empty without a fit."""
        return () if self.fit is None else self.fit.effect_estimates

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the frames."""
        overlay = _OVERLAY.format(share=100 * self.overlay_share) if self.overlay_share else ""
        wrong = _MISREGISTERED.format(pairs=counted(self.misregistered, "pair")) if self.misregistered else ""
        inter_coded = _INTER_CODED if self.inter_coded else ""
        return tuple(filter(None, [self.grey_range.note(self.max_grey), overlay, wrong, inter_coded]))

    @cached_property
    def ratios(self) -> ExposureRatios:
        """The exposure ratios of all pairs of frames; empty without a fit."""
        if self.fit is None or self.observations is None:
            return ExposureRatios.none()
        return exposure_ratios(self.fit, self.observations)


def summarise(inputs: FitInputs, settings: DefaultSettings) -> Calibration:
    """Return the calibration that follows from the inputs; curves that they do not determine are None."""
    fit, observations, ratios = inputs.fit, inputs.observations, inputs.ratios
    reach = 0.0 if observations is None or inputs.standing_still else observations.radial_reach
    points = 0 if observations is None else len(observations.starts)
    low, high = inputs.grey_range.grey((0.0, 1.0) if observations is None else measured_greys(observations)).tolist()
    unexplained = unexplained_share(ratios)
    # With exposures that the images contradict, a fit is meaningless, and so are its effects.
    trusted = None if unexplained > CONTRADICTING_UNEXPLAINED_SHARE else fit
    contradictions = () if trusted is None else contradictions_of(trusted)
    verdicts = {
        "response": response_verdict(settings, fit, observations, unexplained, contradictions),
        "vignette": vignette_verdict(
            settings,
            fit,
            reach,
            inputs.standing_still,
            unexplained,
            contradictions=contradictions,
            size=inputs.size,
        ),
    }
    response_known, vignette_known = verdicts["response"].known, verdicts["vignette"].known
    coverage = None if observations is None else coverage_of(observations, fit, inputs.size, inputs.grey_range)
    return Calibration(
        size=inputs.size,
        response=fit.response(inputs.max_grey, (low, high), inputs.grey_range) if fit and response_known else None,
        vignette=fit.usable_vignette(inputs.size) if fit and vignette_known else None,
        verdicts=verdicts,
        vignette_sigma=vignette_sigma(fit, inputs.size) if fit and vignette_known else None,
        noise=inputs.noise,
        exposure_ratios=ratios,
        covariance={} if fit is None else covariance_of(fit, response_known, vignette_known),
        max_grey=inputs.max_grey,
        converged=all(verdict.state == "identifiable" for verdict in verdicts.values()),
        counts={"pairs": inputs.pairs, "samples": points},
        advice=(
            *(remedy for _, remedy in contradictions),
            *(verdict.remedy for verdict in verdicts.values() if verdict.remedy),
            *(() if coverage is None else coverage.gaps(inputs.max_grey, inputs.grey_range)),
        ),
        effects=() if trusted is None else trusted.effect_estimates,
        notes=(
            *(() if fit is None else inputs.notes),
            *(() if trusted is None else notes_of(trusted)),
        ),
        warnings=tuple(what for what, _ in contradictions),
        coverage=coverage,
    )


def vignette_sigma(fit: Fit, size: ImageSize) -> FloatArray:
    """Return the standard deviation of the profile at :data:`PROFILE_RADII`, shape (51,).

    Like the vignette, it is constant beyond the usable radius.
    """
    return fit.vignette_errors(size).sigma(np.minimum(PROFILE_RADII, fit.vignette_basis.usable_radius))


def exposure_ratios(fit: Fit, observations: ExposedObservations) -> ExposureRatios:
    """Return the exposure ratio of every pair of frames, the median over its scene points, with its uncertainty."""
    log_irradiance = fit.log_irradiance(observations)
    exposed = (observations.grey > DARKEST_EXPOSED) & (observations.grey < BRIGHTEST_EXPOSED)
    # Compare each observation with the previous one of the same point: a pair, or neighbours in a static series.
    later = np.flatnonzero((np.diff(observations.point) == 0) & exposed[1:] & exposed[:-1]) + 1
    if not len(later):
        return ExposureRatios.none()
    observed = log_irradiance[later - 1] - log_irradiance[later]
    metadata = observations.log_exposure[later - 1] - observations.log_exposure[later]
    frames = np.stack([observations.frame[later - 1], observations.frame[later]], axis=1)
    pairs, first, pair, count = np.unique(frames, axis=0, return_index=True, return_inverse=True, return_counts=True)
    pair = pair.reshape(-1)  # NumPy 2.0 adds a dimension
    estimated = medians(observed, pair)
    spread = SIGMA_OF_MEDIAN * medians(np.abs(observed - estimated[pair]), pair)
    by_scatter = _sigma_of_medians(spread, count)
    by_curves = _sigma_by_curves(fit, observations, later[np.argsort(pair, kind="stable")], count)
    return ExposureRatios(pairs, np.exp(metadata[first]), np.exp(estimated), count, np.hypot(by_scatter, by_curves))


def _sigma_of_medians(spread: FloatArray, count: IntArray) -> FloatArray:
    """Return the standard deviation of the median of each group of points, from their scatter, shape (groups,)."""
    typical = float(np.median(np.repeat(spread, count)))
    wrong = spread > MISREGISTERED_SPREAD * typical
    return np.where(wrong, MISREGISTERED_SIGMAS * spread, np.sqrt(np.pi / 2 / count) * spread)


def _sigma_by_curves(fit: Fit, observations: ExposedObservations, later: IntArray, count: IntArray) -> FloatArray:
    """Return the standard deviation of each pair's ln k due to the uncertainty of the curves, shape (pairs,)."""
    # ``later`` contains the indices of the pairs' second observations in order, and ``count`` their number per pair.

    def mean_row(one: IntArray) -> FloatArray:
        rows = fit.log_irradiance_rows(observations.grey[one], observations.position[one])
        return np.asarray(rows.mean(axis=0))

    # One pair at a time: the rows of all pairs would take more memory than the rest of a fit.
    mean = np.stack([mean_row(pair - 1) - mean_row(pair) for pair in np.split(later, np.cumsum(count)[:-1])])
    n = mean.shape[1]
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", mean, fit.covariance[:n, :n], mean)))


def covariance_of(fit: Fit, response: bool, vignette: bool) -> dict[str, dict[str, object]]:
    """Return the parameter names and covariances of the known curves, in the format of a calibration."""
    n = len(fit.response_basis)
    found: dict[str, dict[str, object]] = {}
    if response:
        names = [f"gamma({knot:.4f})" for knot in fit.response_basis.knots]
        found["response"] = {"parameters": names, "matrix": fit.covariance[:n, :n].tolist()}
    if vignette:
        part = fit.vignette_part
        found["vignette"] = {
            "parameters": fit.vignette_basis.names,
            "matrix": fit.covariance[part, part].tolist(),
            "prior_walk": fit.hyperparameters.vignette_walk,
            "measured_radius": fit.measured_radius,
        }
    return found
