"""Two calibrations of a camera side by side, whatever files they come in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError
from ospc.evaluation.metrics import (
    GREYS,
    Coverage,
    coverage,
    log_ratio_error,
    response_rmse,
    response_shape_rmse,
    vignette_pixel_rmse,
    vignette_rmse,
)
from ospc.formats.opening import Photometry
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette, radial_profile

_EXPONENTS = (0.1, 10.0)


@dataclass(frozen=True)
class Comparison:
    """How far one calibration is from another that is taken for the truth; None where either lacks the part.

    Attributes
    ----------
    exponent
        γ the first was raised to before; 1 for none.
    response_rmse, response_shape_rmse, log_ratio_error, vignette_rmse, vignette_pixel_rmse
        The metrics of these names; the last for vignettes of equal size only.
    response_coverage
        Share of the second's response within the first's standard deviations, where it states them.
    """

    exponent: float = 1.0
    response_rmse: float | None = None
    response_shape_rmse: float | None = None
    log_ratio_error: float | None = None
    vignette_rmse: float | None = None
    vignette_pixel_rmse: float | None = None
    response_coverage: Coverage | None = None


def compare(estimate: Photometry, truth: Photometry, exponent: float = 1.0) -> Comparison:
    """Return how far a calibration is from another.

    Parameters
    ----------
    estimate, truth
        The calibrations; the second is taken for the truth.
    exponent
        Response and vignette of the first are raised to this power before. Uncertainties are compared only with 1.

    Raises
    ------
    FormatError
        If they have neither response nor vignette in common.
    """
    _check_common(estimate, truth)
    found: dict[str, float | Coverage | None] = {}
    if estimate.response is not None and truth.response is not None:
        response = _powered_response(estimate.response, exponent)
        found |= {
            "response_rmse": response_rmse(response, truth.response),
            "response_shape_rmse": response_shape_rmse(response, truth.response),
            "log_ratio_error": log_ratio_error(response, truth.response),
        }
        if exponent == 1 and estimate.response.inverse_sigma is not None:
            known = truth.response.inverse(estimate.response.levels)
            found["response_coverage"] = coverage(
                estimate.response.inverse_table, estimate.response.inverse_sigma, known
            )
    if estimate.vignette is not None and truth.vignette is not None:
        vignette = _powered_vignette(estimate.vignette, exponent)
        found["vignette_rmse"] = vignette_rmse(vignette, truth.vignette)
        if vignette.size == truth.vignette.size:
            found["vignette_pixel_rmse"] = vignette_pixel_rmse(vignette, truth.vignette)
    return Comparison(exponent=exponent, **found)  # type: ignore[arg-type]


def aligning_exponent(estimate: Photometry, truth: Photometry) -> float:
    """Return the one exponent γ with which g^γ and V^γ of the first come nearest to the second.

    It makes the sum of the squared shape error of the response and the squared error of the vignette's profile
    smallest; what either lacks does not count.

    Raises
    ------
    FormatError
        If they have neither response nor vignette in common.
    NotObservableError
        If no exponent between 0.1 and 10 does.
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

    ends = np.log(_EXPONENTS)
    best = minimize_scalar(error, bounds=tuple(ends), method="bounded", options={"xatol": 1e-6})
    if min(abs(best.x - ends)) < 1e-3:
        raise NotObservableError(
            f"no exponent between {_EXPONENTS[0]} and {_EXPONENTS[1]} brings {estimate.name} near {truth.name}"
        )
    return float(np.exp(best.x))


def _check_common(a: Photometry, b: Photometry) -> None:
    responses = a.response is not None and b.response is not None
    if not responses and (a.vignette is None or b.vignette is None):
        raise FormatError(f"{a.name} and {b.name} have neither response nor vignette in common")


def _powered_response(response: Response, exponent: float) -> Response:
    if exponent == 1:
        return response
    # a ramp far below what is shown keeps values apart that the power would round together
    ramp = np.linspace(0, 1e-12, GREYS)
    return Response.from_values(response.resampled(GREYS) ** exponent + ramp)


def _powered_vignette(vignette: Vignette, exponent: float) -> Vignette:
    return (
        vignette
        if exponent == 1
        else RasterVignette(np.maximum(vignette.image(), np.float32(0)) ** np.float32(exponent))
    )
