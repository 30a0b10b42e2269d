"""Responses a simulated camera can have: analytic ones by name, or a file of values."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ospc.errors import FormatError, SettingError
from ospc.photometry.response import Response

LEVELS = 255 * 8 + 1
"""Table length: every 8-bit grey value, and so every knot given as one, falls on an entry."""

_MAX_FILE_BYTES = 4_000_000


def linear() -> Response:
    """Return the response of the bare sensor, g(M) = M."""
    return Response(_grey(), model={"name": "linear"})


def gamma22() -> Response:
    """Return the power law g(M) = M^2.2."""
    return Response.gamma(2.2, LEVELS)


def srgb() -> Response:
    """Return the transfer function of sRGB (IEC 61966-2-1)."""
    grey = _grey()
    return Response(np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4), model={"name": "srgb"})


def logarithmic(steepness: float = 50.0) -> Response:
    """Return f(I) = ln(1 + aI) / ln(1 + a), a camera with logarithmic compression."""
    inverse = np.expm1(_grey() * math.log1p(steepness)) / steepness
    return Response.from_values(inverse, model={"name": "log", "steepness": steepness})


def filmic(exponent: float = 1.25, half: float = 0.18) -> Response:
    """Return an s-curve with toe and shoulder, f(I) = (1 + c) I^p / (I^p + c).

    The form is that of Naka and Rushton (1966), scaled to reach 1; its inverse is g(M) = (cM / (1 + c − M))^(1/p).
    """
    grey = _grey()
    constant = half**exponent
    inverse = (constant * grey / (1 + constant - grey)) ** (1 / exponent)
    return Response.from_values(inverse, model={"name": "filmic", "exponent": exponent, "half": half})


def tum_narrow() -> Response:
    """Return a camera with knees: g piecewise linear through (0, 0), (88/255, 0.068), (188/255, 0.464), (1, 1)."""
    inverse = np.interp(_grey() * 255, [0, 88, 188, 255], [0, 0.068, 0.464, 1])
    return Response(inverse, model={"name": "tum_narrow"})


def read_response(path: str | Path) -> Response:
    """Read values of g, as ``pcalib.txt`` holds them.

    Parameters
    ----------
    path
        Text file; only its first line is read. At least 256 strictly increasing values at equidistant grey levels,
        shifted and scaled to run from 0 to 1.

    Raises
    ------
    FormatError
        If the file cannot be read or breaks one of these rules.
    """
    place = Path(path)
    try:
        if place.stat().st_size > _MAX_FILE_BYTES:
            raise FormatError(f"{place}: too large for a response; give one line of 256 values")
        lines = place.read_text(encoding="ascii").splitlines()
        values = np.array((lines or [""])[0].split(), dtype=np.float64)
    except (OSError, ValueError) as error:
        raise FormatError(f"{place}: not readable as a response ({error}); give one line of 256 values") from None
    if values.size < 256:
        raise FormatError(f"{place}: a response needs at least 256 values in its first line, this has {values.size}")
    try:
        return Response.from_values(values, model={"name": "file", "file": place.name})
    except FormatError as error:
        raise FormatError(f"{place}: {error}") from None


RESPONSES: dict[str, Callable[[], Response]] = {
    "linear": linear,
    "srgb": srgb,
    "gamma2.2": gamma22,
    "log": logarithmic,
    "filmic": filmic,
    "tum_narrow": tum_narrow,
}
"""The responses that have a name."""


def make_response(choice: str | Path | Response) -> Response:
    """Return the response of a name, of a file, or itself.

    Raises
    ------
    SettingError
        If it is neither the name of a response nor a file.
    FormatError
        If the file does not hold a response.
    """
    if isinstance(choice, Response):
        return choice
    if str(choice) in RESPONSES:
        return RESPONSES[str(choice)]()
    if not Path(choice).is_file():
        raise SettingError(f"response '{choice}' is neither a file nor one of {', '.join(RESPONSES)}")
    return read_response(choice)


def _grey() -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.linspace(0.0, 1.0, LEVELS)
