"""A calibration as JSON-compatible values: the documented content of ``calibration.json``."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError, counted
from ospc.photometry.calibration import PROFILE_RADII, SCHEMA, Calibration
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.photometry.geometry import image_size
from ospc.photometry.grey_range import LARGEST_GREY
from ospc.photometry.noise import NoiseModel
from ospc.photometry.non_radial import NON_RADIAL
from ospc.photometry.response import Response
from ospc.photometry.verdict import EffectEstimate, State, Verdict
from ospc.photometry.vignette import (
    LARGEST_ATTENUATION,
    LogSplineVignette,
    PolynomialVignette,
    RasterVignette,
    Vignette,
    diagonal_profile,
)
from ospc.settings.vignette import MOST_RADIAL_TERMS

_LARGEST = 1e12
"""Largest number that is read: no calibration comes close, and larger ones would overflow in use."""
_SMALLEST_RATIO = 1e-12
"""Smallest exposure ratio that is read; smaller ones and zero indicate a damaged file."""
_LEAST_REACH = 1e-3
"""Smallest radius of the last knot of a vignette that is read, in half diagonals: less than a pixel."""
_PROBES_PER_SIDE = 33
"""Grid points per side of the image at which a vignette model is checked; a polynomial has no peaks between them."""

_WRITTEN = (
    *("size", "max_grey", "partial", "converged", "exponent_sigma", "rests_on", "verdicts", "response", "vignette"),
    *("noise", "exposure_ratios", "covariance", "coverage", "counts", "effects", "advice", "notes", "warnings"),
    *("settings", "source", "versions"),
)
"""Names of the fields in the order in which they are written."""


def to_dict(calibration: Calibration) -> dict[str, Any]:
    """Return the content of a calibration; see :meth:`Calibration.as_dict`."""
    content: dict[str, Any] = {"schema": SCHEMA}
    for name in _WRITTEN:
        content[name] = _vignette(calibration) if name == "vignette" else _plain(getattr(calibration, name))
    ratios = calibration.exposure_ratios
    content["exposure_ratios"]["bias"] = ratios.bias if ratios.metadata.size else None
    return content


def _vignette(calibration: Calibration) -> dict[str, Any] | None:
    # Not by its fields: a map goes to its own file, and users' own vignettes need only have an as_dict.
    if calibration.vignette is None:
        return None
    return {
        "model": calibration.vignette.as_dict(),
        "profile_radius": PROFILE_RADII.tolist(),
        "profile": diagonal_profile(calibration.vignette, PROFILE_RADII).tolist(),
        "profile_sigma": _plain(calibration.vignette_sigma),
    }


def _plain(value: Any) -> Any:
    """Return a value as lists and dictionaries."""
    if isinstance(value, Coverage):
        return value.as_dict()
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if is_dataclass(value):
        return {entry.name: _plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, dict):
        return {name: _plain(held) for name, held in value.items()}
    return [_plain(held) for held in value] if isinstance(value, tuple | list) else value


def from_dict(content: dict[str, Any], map_file: Path | None) -> Calibration:
    """Return the calibration from the values of :func:`to_dict`.

    All values are checked, so that a damaged or hostile file fails when it is loaded, not when it is used.
    ``map_file`` has the map of a raster vignette; without it, such vignettes are refused.

    Raises
    ------
    FormatError
        If values are missing or impossible, or the map cannot be read.
    """
    try:
        return _calibration(content, map_file)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise FormatError(f"{type(error).__name__}: {error}") from None


def _calibration(content: dict[str, Any], map_file: Path | None) -> Calibration:
    size = _size(content["size"])
    response, vignette, noise = content["response"], content["vignette"], content["noise"]
    coverage = content.get("coverage")
    sigma = None if vignette is None else vignette["profile_sigma"]
    return Calibration(
        size=size,
        response=None if response is None else _response_from_dict(response),
        vignette=None if vignette is None else _vignette_from_dict(vignette["model"], size, map_file),
        verdicts={name: _verdict(verdict) for name, verdict in content["verdicts"].items()},
        vignette_sigma=None if sigma is None else _array(sigma, "profile_sigma", PROFILE_RADII.shape),
        noise=None if noise is None else _noise(noise),
        exposure_ratios=_ratios(content["exposure_ratios"]),
        covariance={name: _covariance(part) for name, part in content["covariance"].items()},
        max_grey=_integer(content["max_grey"], "max_grey", 1, LARGEST_GREY),
        converged=bool(content["converged"]),
        partial=bool(content["partial"]),
        exponent_sigma=_number({"exponent_sigma": 0.0} | content, "exponent_sigma"),
        rests_on=_text(content.get("rests_on", "")),
        counts={name: _integer(count, name, 0) for name, count in content["counts"].items()},
        settings=dict(content["settings"].items()),
        source=dict(content["source"].items()),
        versions={name: _text(version) for name, version in content["versions"].items()},
        advice=_sentences(content["advice"], "advice"),
        notes=_sentences(content["notes"], "notes"),
        warnings=_sentences(content["warnings"], "warnings"),
        effects=tuple(_effect(effect) for effect in content.get("effects", [])),
        coverage=None if coverage is None else Coverage.from_dict(coverage),
    )


def _response_from_dict(content: dict[str, Any]) -> Response:
    table = _array(content["inverse_table"], "inverse_table", (None,))
    if table.size > LARGEST_GREY + 1:
        raise FormatError(f"inverse_table has {table.size} values, more than the number of grey levels")
    log_sigma = None if content["log_sigma"] is None else _array(content["log_sigma"], "log_sigma", table.shape)
    scale_sigma = None if content["scale_sigma"] is None else _number(content, "scale_sigma")
    low, high = _array(content["support"], "support", (2,)).tolist()
    reference = _number(content, "reference_grey") if "reference_grey" in content else math.nan
    return Response(table, log_sigma, scale_sigma, (low, high), dict(content["model"].items()), reference)


def _vignette_from_dict(model: dict[str, Any], size: ImageSize, map_file: Path | None) -> Vignette:
    if _size(model["size"]) != size:
        raise FormatError(f"the vignette is for images of {model['size']} pixels instead of {list(size)}")
    if model["name"] == "raster":
        if map_file is None:
            raise FormatError("the vignette is a map, which these values do not contain; load the calibration file")
        return RasterVignette.read_map(map_file, size, dict(model["source"].items()))
    coefficients = tuple(_signed(model["coefficients"], "coefficients", (None,)).tolist())
    if len(coefficients) > MOST_RADIAL_TERMS:
        raise FormatError(f"the vignette has {len(coefficients)} coefficients, more than {MOST_RADIAL_TERMS}")
    vignette: Vignette
    if model["name"] == "polynomial":
        x, y = _signed(model.get("centre", (0.0, 0.0)), "centre", (2,)).tolist()
        vignette = PolynomialVignette(size, coefficients, (x, y))
    elif model["name"] == "log_spline":
        if not coefficients:
            raise FormatError("a spline has no coefficients")
        non_radial = tuple(_signed(model["non_radial"], "non_radial", (None,)).tolist())
        if len(non_radial) not in (0, len(NON_RADIAL)):
            raise FormatError(
                f"non_radial has {counted(len(non_radial), 'value')} instead of {len(NON_RADIAL)} or none"
            )
        x, y = _signed(model["centre"], "centre", (2,)).tolist()
        limit = _number(model, "limit") if "limit" in model else math.inf
        reach = _number(model, "reach", low=_LEAST_REACH)
        vignette = LogSplineVignette(size, coefficients, (x, y), non_radial, limit, reach)
    else:
        raise FormatError(f"unknown vignette model {model['name']!r}")
    x_px, y_px = (np.linspace(0, side - 1, _PROBES_PER_SIDE) for side in size)
    with np.errstate(over="ignore", invalid="ignore"):
        values = vignette.at(np.stack(np.meshgrid(x_px, y_px), axis=-1))
    if not (values.max() > 0 and np.abs(values).max() <= LARGEST_ATTENUATION):
        raise FormatError("the vignette is not finite or not plausible in parts of the image")
    return vignette


def _verdict(content: dict[str, str]) -> Verdict:
    verdict = Verdict(**{name: _text(text) for name, text in content.items()})  # type: ignore[arg-type]
    if verdict.state not in get_args(State):
        raise FormatError(f"unknown verdict {verdict.state!r}")
    return verdict


def _effect(content: dict[str, Any]) -> EffectEstimate:
    value, sigma = (_number(content, name, low=-_LARGEST) for name in ("value", "sigma"))
    return EffectEstimate(
        _text(content["name"]), value, sigma, bool(content["corrected"]), bool(content["contradicts"])
    )


def _noise(content: dict[str, Any]) -> NoiseModel:
    """Return the noise model; its variances are in units of full scale squared."""
    table = _array(content["table"], "noise table", (None,), high=1.0)
    if table.size > LARGEST_GREY + 1:
        raise FormatError(f"the noise table has {table.size} values, more than the number of grey levels")
    read, shot = (_number(content, name, high=1.0) for name in ("read_variance", "shot_variance"))
    lowest, highest = _array(content.get("measured", (0.0, 1.0)), "measured grey levels", (2,), high=1.0).tolist()
    known = {"gain_from_log_exposure": 0.0, "gain_power": 0.0} | content
    begin = _number(known, "gain_from_log_exposure", low=-_LARGEST)
    return NoiseModel(read, shot, tuple(table.tolist()), (lowest, highest), begin, _number(known, "gain_power"))


def _ratios(content: dict[str, Any]) -> ExposureRatios:
    pairs = len(content["frames"])
    frames = _array(content["frames"], "frames", (pairs, 2) if pairs else (0,)).reshape(-1, 2)
    metadata, estimated = (
        _array(content[name], name, (pairs,), low=_SMALLEST_RATIO) for name in ("metadata", "estimated")
    )
    samples = _array(content["samples"], "samples", (pairs,))
    log_sigma = None if content["log_sigma"] is None else _array(content["log_sigma"], "log_sigma", (pairs,))
    return ExposureRatios(frames.astype(np.int64), metadata, estimated, samples.astype(np.int64), log_sigma)


def _covariance(content: dict[str, Any]) -> dict[str, Any]:
    count = len(content["parameters"])
    _signed(content["matrix"], "covariance matrix", (count, count) if count else (0,))
    return {**content, "parameters": [_text(name) for name in content["parameters"]]}


def _size(content: list[Any]) -> ImageSize:
    width, height = content
    return image_size(_integer(width, "width", 1), _integer(height, "height", 1))


def _array(
    values: Any, name: str, shape: tuple[int | None, ...], low: float = 0.0, high: float = _LARGEST
) -> FloatArray:
    """Return an array of finite numbers between two limits; None in ``shape`` allows any length."""
    array = np.array(values, dtype=np.float64)
    if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        expected = "x".join("n" if n is None else str(n) for n in shape) or "a single number"
        raise FormatError(f"{name} has the shape {array.shape} instead of {expected}")
    if not np.all((array >= low) & (array <= high)):
        raise FormatError(f"{name} has values that are not between {low:g} and {high:g}")
    return array


def _number(content: dict[str, Any], name: str, low: float = 0.0, high: float = _LARGEST) -> float:
    return float(_array(content[name], name, (), low, high))


def _signed(values: Any, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    return _array(values, name, shape, low=-_LARGEST)


def _integer(value: Any, name: str, low: int, high: int = 2**53) -> int:
    if not isinstance(value, int) or not low <= value <= high:
        raise FormatError(f"{name} is {str(value)[:30]}, not an integer between {low} and {high}")
    return int(value)


def _sentences(values: Any, name: str) -> tuple[str, ...]:
    if not isinstance(values, list):
        raise FormatError(f"{name} is not a list of texts")
    return tuple(_text(value) for value in values)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise FormatError(f"expected a text instead of {str(value)[:30]!r}")
    return value
