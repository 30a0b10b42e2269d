"""A calibration as JSON-compatible values: the documented content of ``calibration.json``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.photometry.calibration import PROFILE_RADII, SCHEMA, Calibration
from ospc.photometry.coverage import Coverage
from ospc.photometry.exposure_ratios import ExposureRatios
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import (
    LogVignette,
    PolynomialVignette,
    RasterVignette,
    Vignette,
    diagonal_profile,
)


def to_dict(calibration: Calibration) -> dict[str, Any]:
    """Return everything that is in a calibration; see :meth:`Calibration.as_dict`."""
    ratios = calibration.exposure_ratios
    return {
        "schema": SCHEMA,
        "size": list(calibration.size),
        "max_grey": calibration.max_grey,
        "partial": calibration.partial,
        "converged": calibration.converged,
        "exponent_sigma": calibration.exponent_sigma,
        "verdicts": {name: vars(verdict) for name, verdict in calibration.verdicts.items()},
        "response": _response_as_dict(calibration.response),
        "vignette": _vignette_as_dict(calibration.vignette, calibration.vignette_sigma),
        "noise": None if calibration.noise is None else vars(calibration.noise),
        "exposure_ratios": {
            "frames": ratios.frames.tolist(),
            "metadata": ratios.metadata.tolist(),
            "estimated": ratios.estimated.tolist(),
            "samples": ratios.samples.tolist(),
            "bias": None if not ratios.metadata.size else ratios.bias,
        },
        "covariance": calibration.covariance,
        "coverage": None if calibration.coverage is None else calibration.coverage.as_dict(),
        "counts": calibration.counts,
        "advice": list(calibration.advice),
        "settings": calibration.settings,
        "source": calibration.source,
        "versions": calibration.versions,
    }


def _response_as_dict(response: Response | None) -> dict[str, Any] | None:
    if response is None:
        return None
    return {
        "inverse_table": response.inverse_table.tolist(),
        "inverse_sigma": None if response.inverse_sigma is None else response.inverse_sigma.tolist(),
        "log_sigma": None if response.log_sigma is None else response.log_sigma.tolist(),
        "support": list(response.support),
        "model": response.model,
    }


def _vignette_as_dict(vignette: Vignette | None, sigma: FloatArray | None) -> dict[str, Any] | None:
    if vignette is None:
        return None
    return {
        "model": vignette.as_dict(),
        "profile_radius": PROFILE_RADII.tolist(),
        "profile": diagonal_profile(vignette, PROFILE_RADII).tolist(),
        "profile_sigma": None if sigma is None else sigma.tolist(),
    }


def _vignette_from_dict(content: dict[str, Any], place: Path) -> Vignette:
    model = content["model"]
    size = (int(model["size"][0]), int(model["size"][1]))
    if model["name"] == "polynomial":
        return PolynomialVignette(size, tuple(map(float, model["coefficients"])))
    if model["name"] == "log_polynomial":
        centre = model["centre"]
        return LogVignette(
            size,
            tuple(map(float, model["coefficients"])),
            (float(centre[0]), float(centre[1])),
            tuple(map(float, model["non_radial"])),
            float(model.get("limit", math.inf)),
        )
    if model["name"] == "raster":
        return RasterVignette.read_map(place.with_suffix(".vignette.npz"), size, model["source"])
    raise ValueError(f"unknown vignette model {model['name']!r}")


def from_dict(content: dict[str, Any], place: Path) -> Calibration:
    """Return the calibration of which :func:`to_dict` gave the content.

    Parameters
    ----------
    content
        The content.
    place
        The file it is from, beside which lies the map of a raster vignette.

    Raises
    ------
    FormatError
        If that map cannot be read.
    LookupError, TypeError, ValueError, AttributeError, ArithmeticError
        If it is no such content.
    """
    response, vignette, noise = content["response"], content["vignette"], content["noise"]
    ratios = content["exposure_ratios"]
    sigma = None if vignette is None else vignette["profile_sigma"]
    if vignette is not None and vignette["model"]["size"] != content["size"]:
        raise ValueError("the vignette is not of the images' size")
    if len({len(ratios[name]) for name in ("frames", "metadata", "estimated", "samples")}) > 1:
        raise ValueError("the columns of the exposure ratios are not of one length")
    return Calibration(
        size=(int(content["size"][0]), int(content["size"][1])),
        response=None
        if response is None
        else Response(
            np.array(response["inverse_table"], dtype=np.float64),
            response["inverse_sigma"],
            response["log_sigma"],
            (float(response["support"][0]), float(response["support"][1])),
            response["model"],
        ),
        vignette=None if vignette is None else _vignette_from_dict(vignette, place),
        verdicts={name: Verdict(**verdict) for name, verdict in content["verdicts"].items()},
        vignette_sigma=None if sigma is None else np.array(sigma, dtype=np.float64),
        noise=None if noise is None else NoiseModel(**noise),
        exposure_ratios=ExposureRatios(
            np.array(ratios["frames"], dtype=np.int64).reshape(-1, 2),
            np.array(ratios["metadata"], dtype=np.float64),
            np.array(ratios["estimated"], dtype=np.float64),
            np.array(ratios["samples"], dtype=np.int64),
        ),
        covariance=content["covariance"],
        max_grey=int(content["max_grey"]),
        converged=bool(content["converged"]),
        partial=bool(content["partial"]),
        exponent_sigma=float(content.get("exponent_sigma", 0.0)),
        counts=content["counts"],
        settings=content["settings"],
        source=content["source"],
        versions=content["versions"],
        advice=tuple(content["advice"]),
        coverage=None if content.get("coverage") is None else Coverage.from_dict(content["coverage"]),
    )
