"""From a fit to a calibration: curves with their uncertainty, verdicts, exposure ratios, advice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.estimation.fit import Fit
from ospc.methods.coverage import coverage_of
from ospc.methods.identifiability import response_verdict, vignette_verdict
from ospc.observations import Observations
from ospc.photometry.calibration import PROFILE_RADII, Calibration, ExposureRatios
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.photometry.vignette import LogVignette
from ospc.settings import DefaultSettings

_MAX_LEVELS = 4096
_BLACK, _WHITE = 1.5 / 255, 253.5 / 255


@dataclass(frozen=True)
class Evidence:
    """All that a summary is drawn from.

    Attributes
    ----------
    size, max_grey
        Of the frames.
    noise
        Noise of single pixels.
    observations
        What was seen; None if nothing.
    fit
        Fit to the observations; None where they do not allow one.
    exposure_range_ms
        Shortest and longest exposure.
    standing_still
        Whether the camera did not move.
    pairs
        Pairs of frames compared.
    usable_radius
        Radius in half diagonals that the usable part of the image reaches: less than 1 in a fisheye's image.
    """

    size: ImageSize
    max_grey: int
    noise: NoiseModel
    observations: Observations | None
    fit: Fit | None
    exposure_range_ms: tuple[float, float]
    standing_still: bool
    pairs: int
    usable_radius: float = 1.0


def summarise(evidence: Evidence, settings: DefaultSettings) -> Calibration:
    """Return the calibration that the evidence amounts to; parts that it does not determine are None."""
    fit, observations = evidence.fit, evidence.observations
    ratios = ExposureRatios.none() if fit is None or observations is None else exposure_ratios(fit, observations)
    reach = 0.0 if observations is None or evidence.standing_still else radial_reach(observations)
    points = 0 if observations is None else len(observations.starts)
    verdicts = {
        "response": response_verdict(settings, fit, evidence.exposure_range_ms, points, ratios),
        "vignette": vignette_verdict(settings, fit, reach, evidence.standing_still, evidence.usable_radius),
    }
    response_known, vignette_known = (verdicts[name].known and fit is not None for name in ("response", "vignette"))
    return Calibration(
        size=evidence.size,
        response=response_of(fit, evidence.max_grey, observations) if fit is not None and response_known else None,
        vignette=vignette_of(fit, evidence.size, evidence.usable_radius)
        if fit is not None and vignette_known
        else None,
        verdicts=verdicts,
        vignette_sigma=vignette_sigma(fit) if fit is not None and vignette_known else None,
        noise=evidence.noise,
        exposure_ratios=ratios,
        covariance={} if fit is None else covariance_of(fit, response_known, vignette_known),
        max_grey=evidence.max_grey,
        converged=all(verdict.state == "identifiable" for verdict in verdicts.values()),
        counts={"pairs": evidence.pairs, "samples": points},
        advice=tuple(verdict.remedy for verdict in verdicts.values() if verdict.remedy),
        coverage=None if observations is None else coverage_of(observations, fit, evidence.size),
    )


def response_of(fit: Fit, max_grey: int, observations: Observations | None = None) -> Response:
    """Return the response of a fit, one level for each grey value up to 12 bits, with ±1σ."""
    levels = min(max_grey + 1, _MAX_LEVELS)
    grey = np.linspace(0, 1, levels)
    log_g = np.interp(grey, fit.response_basis.grid, fit.response_basis.log_of(fit.response_parameters))
    table = np.exp(log_g)
    # g(0) = 0; a gamma as steep as 20 near black is zero in floating point for more than one level.
    table = np.maximum(np.where(grey > 0, table, 0.0), np.arange(levels) * 1e-12)
    log_sigma = fit.log_response_sigma(grey)
    support = (0.0, 1.0)
    if observations is not None:
        support = tuple(np.quantile(observations.grey, [0.002, 0.998]).tolist())
    return Response.from_values(
        table,
        inverse_sigma=table / table[-1] * log_sigma,
        log_sigma=log_sigma,
        support=support,
        model={
            "name": "local gamma",
            "knots": fit.response_basis.knots.tolist(),
            "coefficients": fit.response_parameters.tolist(),
            "prior_walk": fit.hyperparameters.walk,
            "prior_drift": fit.hyperparameters.drift,
        },
    )


def vignette_of(fit: Fit, size: ImageSize, usable_radius: float = 1.0) -> LogVignette:
    """Return the vignette of a fit, up to the radius that the usable part of the image reaches."""
    return fit.vignette_basis.vignette(fit.vignette_parameters, size, usable_radius)


def vignette_sigma(fit: Fit) -> FloatArray:
    """Return the standard deviation of the profile at :data:`PROFILE_RADII`, shape (51,)."""
    along = np.stack([PROFILE_RADII, PROFILE_RADII], axis=1) / np.sqrt(2)
    value = np.exp(fit.vignette_basis.log_value(fit.vignette_parameters, along))
    return np.asarray(value * fit.log_vignette_sigma(PROFILE_RADII))


def radial_reach(observations: Observations) -> float:
    """Return the radial displacement, in half diagonals, that a tenth of the scene points exceed."""
    radius = np.linalg.norm(observations.position, axis=1)
    starts = observations.starts
    reach = np.maximum.reduceat(radius, starts) - np.minimum.reduceat(radius, starts)
    return float(np.quantile(reach, 0.9))


def exposure_ratios(fit: Fit, observations: Observations) -> ExposureRatios:
    """Return the exposure ratio of every pair of frames: the median over its scene points."""
    log_g = np.interp(
        observations.grey, fit.response_basis.grid, fit.response_basis.log_of(fit.response_parameters)
    ) - fit.vignette_basis.log_value(fit.vignette_parameters, observations.position)
    exposed = (observations.grey > _BLACK) & (observations.grey < _WHITE)
    # Each observation against the one before of the same point: a pair, or neighbours in a static series.
    later = np.flatnonzero((np.diff(observations.point) == 0) & exposed[1:] & exposed[:-1]) + 1
    if not len(later):
        return ExposureRatios.none()
    observed = log_g[later - 1] - log_g[later]
    metadata = observations.log_exposure[later - 1] - observations.log_exposure[later]
    frames = np.stack([observations.frame[later - 1], observations.frame[later]], axis=1)
    pairs, member = np.unique(frames, axis=0, return_inverse=True)
    member = member.reshape(-1)
    order = np.argsort(member, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(member))[:-1])
    return ExposureRatios(
        pairs,
        np.exp([metadata[g[0]] for g in groups]),
        np.exp([np.median(observed[g]) for g in groups]),
        np.array([len(g) for g in groups], dtype=np.int64),
    )


def covariance_of(fit: Fit, response: bool, vignette: bool) -> dict[str, dict[str, object]]:
    """Return the parameters' names and their covariance for the parts that are known, as a calibration keeps them."""
    n = len(fit.response_basis)
    found: dict[str, dict[str, object]] = {}
    if response:
        names = [f"gamma({knot:.4f})" for knot in fit.response_basis.knots]
        found["response"] = {"parameters": names, "matrix": fit.covariance[:n, :n].tolist()}
    if vignette:
        found["vignette"] = {"parameters": fit.vignette_basis.names, "matrix": fit.covariance[n:, n:].tolist()}
    return found
