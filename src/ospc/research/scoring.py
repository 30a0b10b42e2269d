"""The errors of an estimate whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, counted
from ospc.evaluation.metrics import (
    coverage,
    log_ratio_error,
    response_rmse,
    response_shape_rmse,
    vignette_pixel_rmse,
    vignette_rmse,
)
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile
from ospc.research.held_out import HeldOut, predicted_ratio, prediction_error
from ospc.research.measurement import Measurement
from ospc.research.method import Estimate, Result

if TYPE_CHECKING:
    from ospc.research.source import Source

_COVERED_RADII = PROFILE_RADII > 0.1
"""Radii at which coverage is counted: V is 1 at the centre by definition."""


@dataclass(frozen=True)
class Truth:
    """What is known of the camera of a recording.

    Where ``greys`` are given, the response is known between these two grey values only: its shape is compared, and
    only there. Exposures are by the index of the frame; ``limits`` are those of :class:`Measurement`.
    """

    response: Response | None = None
    vignette: Vignette | None = None
    greys: tuple[int, int] | None = None
    exposures_ms: Mapping[int, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)


def measurement(source: Source, result: Result, truth: Truth, held_out: HeldOut) -> Measurement:
    """Compare the outcome of a method on a recording with the truth."""
    row = Measurement(source.name, result.variant, group=source.group, factors=source.factors)
    row = replace(row, limits=truth.limits, seconds=result.seconds)
    outcome = result.outcome
    if isinstance(outcome, str):
        return replace(row, failure=outcome)
    row = replace(row, figures=score(outcome, truth, held_out), curves=curves_of(outcome))
    if outcome.calibration is None:
        return row
    verdicts, ratios = outcome.calibration.verdicts, vars(outcome.calibration.exposure_ratios)
    return replace(
        row,
        states={name: verdict.state for name, verdict in verdicts.items()},
        reasons={name: verdict.reason for name, verdict in verdicts.items()},
        ratios={name: values.tolist() for name, values in ratios.items() if values is not None},
    )


def score(estimate: Estimate, truth: Truth, held_out: HeldOut = HeldOut()) -> dict[str, float]:  # noqa: B008 - frozen
    """Return the figures of an estimate that are known, by the names in :data:`~ospc.research.measurement.METRICS`.

    Where the response is the very one taken for the truth, its predictions are all there is to judge.
    """
    figures: dict[str, float] = {}
    response, vignette, true = estimate.response, estimate.vignette, truth.response
    if response is not None and true is not None and not np.array_equal(response.inverse_table, true.inverse_table):
        figures |= _response_figures(response, true, truth.greys)
    if response is not None and held_out.pairs:
        error = prediction_error(held_out.pairs, response, vignette)
        figures |= {"ratio_median_abs": error.median_abs, "ratio_bias": error.bias}
    if response is not None and held_out.factor_pairs:
        found = [predicted_ratio(p, response, vignette) / p.exposure_ratio for p in held_out.factor_pairs]
        figures["factor_error_percent"] = float(np.median(np.abs(np.array(found) - 1) * 100))
    if vignette is not None and truth.vignette is not None:
        sigma = None if estimate.calibration is None else estimate.calibration.vignette_sigma
        figures |= _vignette_figures(vignette, truth.vignette, sigma)
    if estimate.exposures is not None:
        figures["exposure_error"] = exposure_error(estimate.exposures, truth.exposures_ms)
    return figures


def _response_figures(estimate: Response, truth: Response, greys: tuple[int, int] | None) -> dict[str, float]:
    figures = {"response_shape_rmse": response_shape_rmse(estimate, truth, *(greys or ()))}
    if greys is not None:
        return figures
    figures["response_rmse"] = response_rmse(estimate, truth)
    figures["log_ratio_error"] = log_ratio_error(estimate, truth)
    if estimate.inverse_sigma is not None:
        seen = (estimate.levels >= estimate.support[0]) & (estimate.levels <= estimate.support[1])
        curves = (estimate.inverse_table, estimate.inverse_sigma, estimate.matched(truth))
        figures |= _coverage("response", *(curve[seen] for curve in curves))
    return figures


def _vignette_figures(estimate: Vignette, truth: Vignette, sigma: FloatArray | None) -> dict[str, float]:
    figures = {"vignette_rmse": vignette_rmse(estimate, truth)}
    if estimate.size == truth.size:
        figures["vignette_pixel_rmse"] = vignette_pixel_rmse(estimate, truth)
    if sigma is not None:
        curves = (profile_along_diagonal(estimate), sigma, profile_along_diagonal(truth))
        figures |= _coverage("vignette", *(curve[_COVERED_RADII] for curve in curves))
    return figures


def _coverage(part: str, estimate: FloatArray, sigma: FloatArray, truth: FloatArray) -> dict[str, float]:
    return dict(
        zip((f"{part}_within_1_sigma", f"{part}_within_2_sigma"), coverage(estimate, sigma, truth), strict=True)
    )


def exposure_error(estimate: Mapping[int, float], truth: Mapping[int, float]) -> float:
    """Return the root mean square error of ln e by frame, after the best common factor, which cannot be observed.

    Estimates that are not positive, or of frames that the recording does not have, are an ExposureError.
    """
    values = np.array(list(estimate.values()), dtype=np.float64)
    if not np.all(np.isfinite(values) & (values > 0)):
        raise ExposureError("estimated exposures must be finite and above 0")
    unknown = len(estimate.keys() - truth.keys())
    if unknown or not estimate:
        raise ExposureError(
            f"exposures were estimated for {counted(len(estimate), 'frame')}, of which the recording lacks {unknown}"
            f"; give one for each frame"
        )
    return float(np.std(np.log(values) - np.log([truth[frame] for frame in estimate])))


def profile_along_diagonal(vignette: Vignette) -> FloatArray:
    """Return V from the image centre to a corner, divided by V at the centre, at :data:`PROFILE_RADII`."""
    corner = np.array(vignette.size, dtype=np.float64) - 1
    along = vignette.at(corner / 2 + PROFILE_RADII[:, None] * corner / 2)
    return np.asarray(along / along[0])


def curves_of(found: Estimate | Truth) -> dict[str, list[float]]:
    """Return g at the 256 grey levels and the profile of V in 50 rings, 1 at the centre, as far as they are known."""
    curves: dict[str, list[float]] = {}
    if found.response is not None:
        curves["response"] = found.response.inverse(np.arange(256) / 255).tolist()
    if found.vignette is not None:
        curves["vignette"] = radial_profile(found.vignette).tolist()
    return curves
