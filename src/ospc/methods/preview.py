"""Quick estimates of a method during a run, cheap enough to request repeatedly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.estimation.fit import Fit, measured_greys
from ospc.methods.coverage import coverage_of
from ospc.methods.summary import vignette_sigma
from ospc.observations import ExposedObservations
from ospc.photometry.coverage import Coverage
from ospc.photometry.geometry import pixels_of
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette


@dataclass(frozen=True)
class Matches:
    """Scene points seen in two frames.

    Attributes
    ----------
    frames, exposures_ms
        Indices of the earlier and the later frame, and their exposures.
    points0, points1
        Pixel coordinates in the two frames, shapes (n, 2).
    log_ratios
        ln of the exposure ratio e₀/e₁ measured at each point, shape (n,); None before there is an estimate.
    """

    frames: tuple[int, int]
    exposures_ms: tuple[float, float]
    points0: FloatArray
    points1: FloatArray
    log_ratios: FloatArray | None


@dataclass(frozen=True)
class Preview:
    """Quick estimates, and the data behind them.

    Attributes
    ----------
    pairs
        Number of pairs of frames compared so far.
    coverage
        Coverage of the measurements, without residuals.
    response, vignette
        Estimates from some of the measurements; None before there are any. They have no verdict yet; their standard
        deviations indicate how reliable they are.
    vignette_sigma
        Standard deviation of the vignette's profile at the 51 radii 0, 0.02, … 1, shape (51,).
    matches
        Points of the latest pair of frames; None if it had none.
    observations, fit
        All observations, and the latest quick fit (None before there is one), from which advice is derived.
    """

    pairs: int
    coverage: Coverage
    response: Response | None = None
    vignette: Vignette | None = None
    vignette_sigma: FloatArray | None = None
    matches: Matches | None = None
    observations: ExposedObservations | None = None
    fit: Fit | None = None


def preview_of(
    observations: ExposedObservations,
    latest: ExposedObservations | None,
    fit: Fit | None,
    *,
    size: ImageSize,
    max_grey: int,
    pairs: int,
) -> Preview:
    """Return the preview for all observations, those of the latest pair of frames, and the latest quick fit.

    Parameters
    ----------
    size, max_grey
        Width and height of the frames in pixels, and their largest grey value.
    pairs
        Number of pairs of frames compared so far.
    """
    return Preview(
        pairs,
        coverage_of(observations, None, size),
        response=fit.response(max_grey, measured_greys(observations)) if fit else None,
        vignette=fit.usable_vignette(size) if fit else None,
        vignette_sigma=vignette_sigma(fit, size) if fit else None,
        matches=_matches_of(latest, fit, size),
        observations=observations,
        fit=fit,
    )


def _matches_of(latest: ExposedObservations | None, fit: Fit | None, size: ImageSize) -> Matches | None:
    """Return the matches of a pair of frames; None without any."""
    if latest is None or not len(latest):
        return None
    pixel = pixels_of(latest.position, size)
    first_ms, second_ms = np.exp(latest.log_exposure[:2]).tolist()
    ratios = None
    if fit is not None:
        log_irradiance = fit.log_irradiance(latest)
        ratios = log_irradiance[::2] - log_irradiance[1::2]
    frames = int(latest.frame[0]), int(latest.frame[1])
    return Matches(frames, (first_ms, second_ms), pixel[::2], pixel[1::2], ratios)
