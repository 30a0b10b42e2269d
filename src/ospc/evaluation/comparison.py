"""Compare two calibrations of a camera in any format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError
from ospc.evaluation.metrics import (
    Coverage,
    coverage,
    log_ratio_error,
    response_rmse,
    response_shape_rmse,
    vignette_pixel_rmse,
    vignette_rmse,
)
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette, half_diagonal_profiles, radial_profile
from ospc.settings.evaluation import END_OF_RANGE, EXPONENT_RANGE, METRIC_GREYS, MIN_COVERED_RADIUS, RAMP_HEIGHT


@dataclass(frozen=True)
class Comparison:
    """Errors of one calibration against another that is treated as the truth; None if either lacks the part.

    Attributes
    ----------
    exponent
        Power γ to which the first was raised before the comparison.
    response_rmse, response_shape_rmse, log_ratio_error, vignette_rmse, vignette_pixel_rmse
        The metrics of these names; the last only for vignettes of equal size.
    response_coverage, vignette_coverage
        Share of the second response, and of the second vignette along the half diagonals, within the standard
        deviations of the first, if it states them.
    """

    exponent: float = 1.0
    response_rmse: float | None = None
    response_shape_rmse: float | None = None
    log_ratio_error: float | None = None
    vignette_rmse: float | None = None
    vignette_pixel_rmse: float | None = None
    response_coverage: Coverage | None = None
    vignette_coverage: Coverage | None = None


def compare(estimate: Photometry, truth: Photometry, exponent: float = 1.0) -> Comparison:
    """Return the errors of a calibration against another that is treated as the truth.

    Response and vignette of the first are raised to the power ``exponent`` first. Uncertainties are only evaluated
    for an exponent of 1.

    Raises
    ------
    FormatError
        If they have neither response nor vignette in common.
    """
    _check_common(estimate, truth)
    found: dict[str, Any] = {}
    if estimate.response is not None and truth.response is not None:
        response = _powered_response(estimate.response, exponent)
        found["response_rmse"] = response_rmse(response, truth.response)
        found["response_shape_rmse"] = response_shape_rmse(response, truth.response)
        found["log_ratio_error"] = log_ratio_error(response, truth.response)
        if exponent == 1 and response.inverse_sigma is not None:
            known = response.matched(truth.response)
            seen = response.measured
            sigma = response.inverse_sigma[seen]
            found["response_coverage"] = coverage(response.inverse_table[seen], sigma, known[seen])
    if estimate.vignette is not None and truth.vignette is not None:
        vignette = _powered_vignette(estimate.vignette, exponent)
        found["vignette_rmse"] = vignette_rmse(vignette, truth.vignette)
        if vignette.size == truth.vignette.size:
            found["vignette_pixel_rmse"] = vignette_pixel_rmse(vignette, truth.vignette)
        stated = None if estimate.calibration is None else estimate.calibration.vignette_sigma
        if exponent == 1 and stated is not None:
            seen = PROFILE_RADII > MIN_COVERED_RADIUS
            values, known = (half_diagonal_profiles(v, PROFILE_RADII[seen]) for v in (vignette, truth.vignette))
            found["vignette_coverage"] = coverage(values, stated[seen, None], known)
    return Comparison(exponent, **found)


def aligning_exponent(estimate: Photometry, truth: Photometry) -> float:
    """Return the common exponent γ for which g^γ and V^γ of the first are closest to the second.

    It minimises the squared shape error of the response plus the squared error of the vignette profile. Parts that
    either calibration lacks do not count.

    Raises
    ------
    FormatError
        If they have neither response nor vignette in common.
    NotObservableError
        If there is no minimum between 0.1 and 10.
    """
    _check_common(estimate, truth)
    profiles: tuple[FloatArray, FloatArray] | None = None
    if estimate.vignette is not None and truth.vignette is not None:
        profiles = radial_profile(estimate.vignette), radial_profile(truth.vignette)

    def error(log_exponent: float) -> float:
        exponent = float(np.exp(log_exponent))
        total = 0.0
        if estimate.response is not None and truth.response is not None:
            total += response_shape_rmse(_powered_response(estimate.response, exponent), truth.response) ** 2
        if profiles is not None:
            total += float(np.nanmean((profiles[0] ** exponent - profiles[1]) ** 2))
        return total

    from scipy.optimize import minimize_scalar  # slow to import and rarely needed

    low, high = EXPONENT_RANGE
    ends = np.log([low, high])
    best = minimize_scalar(error, bounds=tuple(ends), method="bounded", options={"xatol": 1e-6})
    if min(abs(best.x - ends)) < END_OF_RANGE:
        raise NotObservableError(f"no exponent between {low} and {high} aligns {estimate.name} with {truth.name}")
    return float(np.exp(best.x))


def _check_common(a: Photometry, b: Photometry) -> None:
    responses = a.response is not None and b.response is not None
    if not responses and (a.vignette is None or b.vignette is None):
        raise FormatError(f"{a.name} and {b.name} have neither response nor vignette in common")


def _powered_response(response: Response, exponent: float) -> Response:
    if exponent == 1:
        return response
    return Response.from_values(
        response.resampled(METRIC_GREYS) ** exponent + np.linspace(0, RAMP_HEIGHT, METRIC_GREYS)
    )


def _powered_vignette(vignette: Vignette, exponent: float) -> Vignette:
    if exponent == 1:
        return vignette
    return RasterVignette(np.maximum(vignette.image(), np.float32(0)) ** np.float32(exponent))
