"""The errors of an estimate whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import ExposureError
from ospc.evaluation.metrics import (
    GREYS,
    coverage,
    log_ratio_error,
    response_rmse,
    response_shape_rmse,
    vignette_pixel_rmse,
    vignette_rmse,
)
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile
from ospc.research.held_out import HeldOut, predicted_ratio, prediction_error
from ospc.research.measurement import Measurement
from ospc.research.method import Estimate, Exposures, Result

if TYPE_CHECKING:
    from ospc.research.source import Source

_COVERED_GREYS = slice(5, 251)
"""Grey levels at which coverage is counted: the ends are fixed or saturated."""

_COVERED_RADII = PROFILE_RADII > 0.1
"""Radii at which coverage is counted: V is 1 at the centre by definition."""


@dataclass(frozen=True)
class Truth:
    """What is known of the camera of a recording.

    Attributes
    ----------
    response, vignette
        The curves; None where they are not known.
    greys
        Lowest and highest grey value between which the response is known, if not everywhere. Only the shape is
        compared then, and only there.
    exposures_ms
        True exposure by the index of the frame.
    limits
        What limits the comparison: see :attr:`Measurement.limits`.
    """

    response: Response | None = None
    vignette: Vignette | None = None
    greys: tuple[int, int] | None = None
    exposures_ms: Mapping[int, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)


def measurement(source: Source, result: Result, truth: Truth, held_out: HeldOut) -> Measurement:
    """Compare the outcome of a method on a recording with the truth."""
    outcome = result.outcome
    common: dict[str, Any] = {
        "group": source.group,
        "factors": dict(source.factors),
        "limits": truth.limits,
        "seconds": result.seconds,
    }
    if isinstance(outcome, str):
        return Measurement(source.name, result.variant, failure=outcome, **common)
    calibration = outcome.calibration
    verdicts = {} if calibration is None else calibration.verdicts
    return Measurement(
        source.name,
        result.variant,
        figures=score(outcome, truth, held_out),
        states={name: verdict.state for name, verdict in verdicts.items()},
        reasons={name: verdict.reason for name, verdict in verdicts.items()},
        curves=curves_of(outcome.response, outcome.vignette),
        ratios={} if calibration is None else _ratios(calibration),
        **common,
    )


def score(estimate: Estimate, truth: Truth, held_out: HeldOut | None = None) -> dict[str, float]:
    """Return the figures of an estimate that are known, by the names in :data:`~ospc.research.measurement.METRICS`.

    Where the response is the very one taken for the truth, its predictions are all there is to judge.
    """
    figures: dict[str, float] = {}
    response, vignette = estimate.response, estimate.vignette
    if response is not None and truth.response is not None and not _same(response, truth.response):
        figures |= _response_figures(response, truth.response, truth.greys)
    if response is not None and held_out is not None:
        figures |= _prediction_figures(response, vignette, held_out)
    if vignette is not None and truth.vignette is not None:
        figures |= _vignette_figures(vignette, truth.vignette)
        sigma = None if estimate.calibration is None else estimate.calibration.vignette_sigma
        if sigma is not None:
            profile, known = profile_along_diagonal(vignette), profile_along_diagonal(truth.vignette)
            figures |= _coverage("vignette", *(curve[_COVERED_RADII] for curve in (profile, sigma, known)))
    if estimate.exposures is not None:
        figures["exposure_error"] = exposure_error(estimate.exposures, truth.exposures_ms)
    return figures


def _same(first: Response, second: Response) -> bool:
    return np.array_equal(first.inverse_table, second.inverse_table)


def _response_figures(estimate: Response, truth: Response, greys: tuple[int, int] | None) -> dict[str, float]:
    figures = {"response_shape_rmse": response_shape_rmse(estimate, truth, *(greys or ()))}
    if greys is not None:
        return figures
    figures |= {
        "response_rmse": response_rmse(estimate, truth),
        "log_ratio_error": log_ratio_error(estimate, truth),
    }
    if estimate.inverse_sigma is not None:
        sigma = np.interp(np.linspace(0, 1, GREYS), estimate.levels, estimate.inverse_sigma)
        curves = (estimate.resampled(GREYS), sigma, truth.resampled(GREYS))
        figures |= _coverage("response", *(curve[_COVERED_GREYS] for curve in curves))
    return figures


def _prediction_figures(response: Response, vignette: Vignette | None, held_out: HeldOut) -> dict[str, float]:
    figures: dict[str, float] = {}
    if held_out.pairs:
        error = prediction_error(held_out.pairs, response, vignette)
        figures |= {"ratio_median_abs": error.median_abs, "ratio_bias": error.bias}
    if held_out.factor_pairs:
        found = [predicted_ratio(p, response, vignette) / p.exposure_ratio for p in held_out.factor_pairs]
        figures["factor_error_percent"] = float(np.median(np.abs(np.array(found) - 1) * 100))
    return figures


def _vignette_figures(estimate: Vignette, truth: Vignette) -> dict[str, float]:
    figures = {"vignette_rmse": vignette_rmse(estimate, truth)}
    if estimate.size == truth.size:
        figures["vignette_pixel_rmse"] = vignette_pixel_rmse(estimate, truth)
    return figures


def _coverage(part: str, estimate: FloatArray, sigma: FloatArray, truth: FloatArray) -> dict[str, float]:
    share = coverage(estimate, sigma, truth)
    return {f"{part}_within_1_sigma": share[0], f"{part}_within_2_sigma": share[1]}


def exposure_error(estimate: Exposures, metadata: Mapping[int, float]) -> float:
    """Return the root mean square error of ln e after the best common factor, which cannot be observed.

    Parameters
    ----------
    estimate
        The exposures.
    metadata
        True exposures by frame.

    Raises
    ------
    ExposureError
        If an estimate is not positive, or belongs to a frame that the recording does not have.
    """
    if not np.all(np.isfinite(estimate.values) & (estimate.values > 0)):
        raise ExposureError("estimated exposures must be finite and above 0")
    unknown = [int(frame) for frame in estimate.frames if int(frame) not in metadata]
    if unknown or not estimate.frames.size:
        raise ExposureError(
            f"exposures were estimated for {estimate.frames.size} frames, of which the recording lacks "
            f"{len(unknown)}; give one for each frame"
        )
    difference = np.log(estimate.values) - np.log([metadata[int(frame)] for frame in estimate.frames])
    return float(np.std(difference))


def profile_along_diagonal(vignette: Vignette) -> FloatArray:
    """Return V from the image centre to a corner, divided by V at the centre, at :data:`PROFILE_RADII`."""
    corner = np.array(vignette.size, dtype=np.float64) - 1
    along = vignette.at(corner / 2 + PROFILE_RADII[:, None] * corner / 2)
    return np.asarray(along / along[0])


def curves_of(response: Response | None, vignette: Vignette | None) -> dict[str, list[float]]:
    """Return g at the 256 grey levels and the profile of V in 50 rings, 1 at the centre, as far as they are known."""
    curves: dict[str, list[float]] = {}
    if response is not None:
        curves["response"] = response.inverse(np.arange(256) / 255).tolist()
    if vignette is not None:
        profile = radial_profile(vignette)
        curves["vignette"] = (profile / profile[:3].mean()).tolist()
    return curves


def _ratios(calibration: Calibration) -> dict[str, list[Any]]:
    found = calibration.exposure_ratios
    return {
        "frames": found.frames.tolist(),
        "metadata": found.metadata.tolist(),
        "estimated": found.estimated.tolist(),
        "samples": found.samples.tolist(),
    }
