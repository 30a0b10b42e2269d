"""The figures of a calibration whose truth is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.benchmark.case import Row
from ospc.benchmark.held_out import HeldOutPair, prediction_error
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
from ospc.photometry.vignette import Vignette

_COVERED_GREYS = slice(5, 251)
_COVERED_RADII = PROFILE_RADII > 0.1


def score(
    method: str,
    calibration: Calibration,
    response: Response | None,
    vignette: Vignette | None,
    *,
    pairs: Sequence[HeldOutPair] = (),
    greys: tuple[int, int] | None = None,
) -> Row:
    """Compare a calibration with the truth.

    Parameters
    ----------
    method
        What to call the method.
    calibration
        What it found.
    response, vignette
        The truth; None where it is not known.
    pairs
        Pairs of frames whose exposure ratio is to be predicted; none to leave that out.
    greys
        Lowest and highest grey value between which the true response is known, if not everywhere; only the shape is
        compared then.
    """
    row = Row(
        method,
        states={name: verdict.state for name, verdict in calibration.verdicts.items()},
        reasons={name: verdict.reason for name, verdict in calibration.verdicts.items()},
    )
    if calibration.response is not None:
        row = _with_response(row, calibration.response, response, greys)
        if pairs:
            error = prediction_error(pairs, calibration.response, calibration.vignette)
            row = with_figures(row, ratio_median_abs=error.median_abs, ratio_bias=error.bias)
    if calibration.vignette is not None and vignette is not None:
        row = _with_vignette(row, calibration.vignette, calibration.vignette_sigma, vignette)
    return row


def _with_response(row: Row, estimate: Response, truth: Response | None, greys: tuple[int, int] | None) -> Row:
    if truth is None:
        return row
    shape = response_shape_rmse(estimate, truth, *(greys or ()))
    row = with_figures(row, response_shape_rmse=shape)
    curve, known = estimate.resampled(GREYS), truth.resampled(GREYS)
    sigma = None if estimate.inverse_sigma is None else np.interp(_levels(), estimate.levels, estimate.inverse_sigma)
    row.curves["response"] = _curve(curve, sigma, known)
    if greys is not None:
        return row
    row = with_figures(
        row, response_rmse=response_rmse(estimate, truth), log_ratio_error=log_ratio_error(estimate, truth)
    )
    if sigma is not None:
        share = coverage(curve[_COVERED_GREYS], sigma[_COVERED_GREYS], known[_COVERED_GREYS])
        row = with_figures(row, response_within_1_sigma=share[0], response_within_2_sigma=share[1])
    return row


def _with_vignette(row: Row, estimate: Vignette, sigma: FloatArray | None, truth: Vignette) -> Row:
    row = with_figures(
        row,
        vignette_rmse=vignette_rmse(estimate, truth),
        vignette_pixel_rmse=vignette_pixel_rmse(estimate, truth),
    )
    profile, known = profile_along_diagonal(estimate), profile_along_diagonal(truth)
    row.curves["vignette"] = _curve(profile, sigma, known)
    if sigma is not None:
        share = coverage(profile[_COVERED_RADII], sigma[_COVERED_RADII], known[_COVERED_RADII])
        row = with_figures(row, vignette_within_1_sigma=share[0], vignette_within_2_sigma=share[1])
    return row


def profile_along_diagonal(vignette: Vignette) -> FloatArray:
    """Return V from the image centre to a corner, divided by V at the centre, at :data:`PROFILE_RADII`."""
    corner = np.array(vignette.size, dtype=np.float64) - 1
    along = vignette.at(corner / 2 + PROFILE_RADII[:, None] * corner / 2)
    return np.asarray(along / along[0])


def with_figures(row: Row, **figures: float) -> Row:
    """Return a row with some figures replaced."""
    return replace(row, figures=replace(row.figures, **figures))


def _levels() -> FloatArray:
    return np.linspace(0.0, 1.0, GREYS)


def _curve(estimate: FloatArray, sigma: FloatArray | None, truth: FloatArray) -> dict[str, list[float] | None]:
    return {
        "estimate": estimate.tolist(),
        "sigma": None if sigma is None else sigma.tolist(),
        "truth": truth.tolist(),
    }
