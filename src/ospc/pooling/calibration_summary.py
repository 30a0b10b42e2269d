"""Convert a calibration of the default method to a summary: the information that it contains without its prior."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError, SettingError
from ospc.estimation.prior import START, Prior, vignette_precision
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.numerics.symmetric import eigh
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.photometry.vignette import LogSplineVignette, Vignette, usable_radius_of
from ospc.pooling.summary import (
    PARAMETERS,
    RESPONSE,
    RESPONSE_PART,
    VIGNETTE,
    VIGNETTE_PART,
    Summary,
    recording_key,
    triangle_of,
)
from ospc.settings.fit import MAX_GAMMA
from ospc.settings.pooling import MAX_RESPONSE_KNOTS, MAX_WALK, MIN_OBSERVED, MIN_RELATIVE_INFORMATION, OMITTED_SIGMA
from ospc.settings.response import MAX_KNEES
from ospc.settings.sampling import ASSUMED_NOISE_SIGMA
from ospc.settings.vignette import VIGNETTE_REACH
from ospc.state.numbers import require


def summary_of_calibration(calibration: Calibration, name: str) -> Summary:
    """Return a calibration as a summary: the information in its covariance minus that of the prior.

    Raises
    ------
    NotObservableError
        If it contains neither response nor vignette.
    FormatError
        If it is not from the default method.
    """
    if calibration.response is None and calibration.vignette is None:
        raise NotObservableError(f"{name}: has neither response nor vignette, so there is nothing to start from")
    try:
        found = _summary_of(calibration, name)
        found.check()
    except (LookupError, TypeError, ValueError, ArithmeticError, FormatError, SettingError, np.linalg.LinAlgError):
        raise FormatError(
            f"{name}: is not a calibration of the default method with a covariance; start from a state.ospc instead"
        ) from None
    return found


def _summary_of(calibration: Calibration, name: str) -> Summary:
    matrix, vector = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
    estimate = np.concatenate([1 + RESPONSE.knots, np.zeros(len(VIGNETTE))])
    grey_range = FULL_RANGE
    if calibration.response is not None:
        found = _of_response(calibration.response.model, calibration.covariance["response"])
        estimate[RESPONSE_PART], matrix[RESPONSE_PART, RESPONSE_PART], vector[RESPONSE_PART] = found
        grey_range = GreyRange(*map(float, calibration.response.model.get("grey_range", (0.0, 1.0))))
    if calibration.vignette is not None:
        found = _of_vignette(calibration.vignette, calibration.covariance["vignette"])
        estimate[VIGNETTE_PART], matrix[VIGNETTE_PART, VIGNETTE_PART], vector[VIGNETTE_PART] = found
    usable_radius, vignette_reach = _knots_of(calibration.vignette)
    range_ms = calibration.source.get("exposure_range_ms") or (1.0, np.e)
    return Summary(
        key=recording_key(f"calibration {name}", calibration.source),
        name=name,
        size=calibration.size,
        max_grey=calibration.max_grey,
        frames=int(calibration.counts.get("frames", 0)),
        pairs=int(calibration.counts.get("pairs", 0)),
        points=int(calibration.counts.get("samples", 1)),
        groups=int(calibration.counts.get("pairs", 1)),
        estimate=estimate,
        triangle=triangle_of(matrix),
        vector=vector,
        systematic=np.zeros_like(triangle_of(matrix)),
        exposure_range_ms=(float(range_ms[0]), float(range_ms[1])),
        radial_motion=1.0 if calibration.vignette is not None else 0.0,
        stationary=calibration.vignette is None,
        support=(0.0, 1.0) if calibration.response is None else calibration.response.support,
        unexplained=0.0,
        noise=calibration.noise or NoiseModel(ASSUMED_NOISE_SIGMA**2, 0.0),
        grey_range=grey_range,
        usable_radius=usable_radius,
        vignette_reach=vignette_reach,
        measured_radius=float(calibration.covariance.get("vignette", {}).get("measured_radius", 1.0)),
    )


def _knots_of(vignette: Vignette | None) -> tuple[float, float]:
    """Return the usable radius of the image to which a vignette was fitted, and the reach of its knots."""
    usable_radius = usable_radius_of(vignette)
    reach = vignette.reach / usable_radius if isinstance(vignette, LogSplineVignette) else VIGNETTE_REACH
    return usable_radius, reach


def _of_response(model: dict[str, Any], uncertainty: dict[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the estimated response parameters, and A and b of their likelihood, for the common response basis."""
    coefficients = np.array(model["coefficients"], dtype=np.float64)
    covariance = np.array(uncertainty["matrix"], dtype=np.float64)
    knots = np.array(model["knots"], dtype=np.float64)
    n = len(coefficients)
    require(2 <= n <= MAX_RESPONSE_KNOTS, "the number of coefficients is impossible")
    require(coefficients.shape == knots.shape and covariance.shape == (n, n), "shapes differ")
    own = ResponseBasis(n - 1, model["functions"])
    require(np.allclose(knots, own.knots), "these are other knots than those of the functions")
    prior = Prior(own, VignetteBasis(0), coefficients, np.empty(0))
    walk, drift, knees = (model[f"prior_{name}"] for name in ("walk", "drift", "knees"))
    hyperparameters = replace(START, walk=float(walk), drift=float(drift), knees=tuple(int(knee) for knee in knees))
    require(all(0 <= sigma <= MAX_WALK for sigma in (float(walk), float(drift))), "the prior is too wide")
    require(len(knees) <= MAX_KNEES and all(0 < knee < n - 1 for knee in hyperparameters.knees), "knees are wrong")
    require(coefficients.min() > 0 and coefficients.max() <= MAX_GAMMA, "a coefficient is impossible")
    from_common = own.conversion(RESPONSE)
    in_own = np.linalg.inv(covariance).astype(np.float64) - prior.precision(hyperparameters)
    information = _positive(from_common.T @ in_own @ from_common)
    estimate = RESPONSE.conversion(own) @ coefficients
    # The roughness of the prior is selected anew, so its share of the estimate cannot be subtracted from b.
    return estimate, information, information @ estimate


def _of_vignette(vignette: Vignette, uncertainty: dict[str, Any]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the estimated vignette parameters, and A and b of their likelihood."""
    if not isinstance(vignette, LogSplineVignette):
        raise TypeError("another model of the vignette")
    covariance = np.array(uncertainty["matrix"], dtype=np.float64)
    given = [*vignette.coefficients]
    place = [*range(len(given))]
    if "centre_x" in uncertainty["parameters"]:
        given, place = [*given, *vignette.centre], [*place, VIGNETTE.radial, VIGNETTE.radial + 1]
    if vignette.non_radial:
        given, place = [*given, *vignette.non_radial], [*place, *range(VIGNETTE.radial + 2, len(VIGNETTE))]
    require(len(vignette.coefficients) == VIGNETTE.radial, "another number of terms")
    require(covariance.shape == (len(place), len(place)), "shapes differ")
    estimate, matrix = np.zeros(len(VIGNETTE)), np.eye(len(VIGNETTE)) / OMITTED_SIGMA**2
    estimate[place] = given
    walk = float(uncertainty["prior_walk"])
    require(0 <= walk <= MAX_WALK, "the prior is too wide")
    precision = np.linalg.inv(covariance).astype(np.float64)
    usable_radius, reach = _knots_of(vignette)
    basis = replace(VIGNETTE, usable_radius=usable_radius, reach=reach)
    of_prior, _ = vignette_precision(basis, walk)
    of_prior = of_prior[np.ix_(place, place)]
    # In units of the prior, so that all parameters have the same scale.
    root = np.linalg.cholesky(of_prior)
    posterior, directions = eigh(np.linalg.solve(root, np.linalg.solve(root, precision).T))
    across = root @ directions
    own = np.maximum(posterior - 1, MIN_RELATIVE_INFORMATION * posterior.max())
    matrix[np.ix_(place, place)] = (across * own) @ across.T
    # The prior is centred on zero: it contributes to the precision, but not to b = A θ of the likelihood.
    vector = np.zeros(len(VIGNETTE))
    vector[place] = across @ (np.where(posterior > 1 + MIN_OBSERVED, posterior, 0.0) * (across.T @ estimate[place]))
    return estimate, matrix, vector


def _positive(matrix: FloatArray) -> FloatArray:
    """Return the nearest positive definite matrix, because rounding may leave negative information in a direction."""
    value, vector = eigh((matrix + matrix.T) / 2)
    require(value.max() > 0, "there is no information")
    return np.asarray((vector * np.maximum(value, MIN_RELATIVE_INFORMATION * value.max())) @ vector.T)
