"""Quick estimates of a method during a run, cheap enough to request repeatedly."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.arrays import FloatArray, ImageSize
from ospc.estimation.fit import Fit, measured_greys
from ospc.methods.coverage import coverage_of
from ospc.methods.result import vignette_sigma
from ospc.observations import ExposedObservations
from ospc.photometry.coverage import Coverage
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette


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
    observations, latest
        All observations, and those of the latest pair of frames; None if it had none.
    fit
        The latest quick fit, from which advice is derived; None before there is one.
    """

    pairs: int
    coverage: Coverage
    response: Response | None = None
    vignette: Vignette | None = None
    vignette_sigma: FloatArray | None = None
    observations: ExposedObservations | None = None
    latest: ExposedObservations | None = None
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
        observations=observations,
        latest=latest,
        fit=fit,
    )
