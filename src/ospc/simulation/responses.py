"""Responses of the simulated camera: analytic ones by name, or a pcalib.txt."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ospc.errors import SettingError
from ospc.formats.dso import read_pcalib
from ospc.photometry.response import Response

LEVELS = 255 * 8 + 1
"""Length of the tables: every 8-bit grey value, and so every knot given as one, falls on an entry."""


def linear() -> Response:
    """Return the response of a linear sensor, g(M) = M."""
    return Response(_grey(), model={"name": "linear"})


def gamma22() -> Response:
    """Return the power law g(M) = M^2.2."""
    return Response.gamma(2.2, LEVELS)


def srgb() -> Response:
    """Return the transfer function of sRGB (IEC 61966-2-1)."""
    grey = _grey()
    return Response(np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4), model={"name": "srgb"})


def logarithmic(steepness: float = 50.0) -> Response:
    """Return f(I) = ln(1 + aI) / ln(1 + a), logarithmic compression."""
    inverse = np.expm1(_grey() * math.log1p(steepness)) / steepness
    return Response.from_values(inverse, model={"name": "log", "steepness": steepness})


def filmic(exponent: float = 1.25, half: float = 0.18) -> Response:
    """Return an S-curve with toe and shoulder, f(I) = (1 + c) I^p / (I^p + c), where c = halfᵖ.

    This is the function of Naka and Rushton (1966), scaled to reach 1. Its inverse is
    g(M) = (cM / (1 + c − M))^(1/p).
    """
    grey = _grey()
    constant = half**exponent
    inverse = (constant * grey / (1 + constant - grey)) ** (1 / exponent)
    return Response.from_values(inverse, model={"name": "filmic", "exponent": exponent, "half": half})


def tum_narrow() -> Response:
    """Return a piecewise linear g through (0, 0), (88/255, 0.068), (188/255, 0.464), (1, 1).

    These are the knees of the camera of the TUM monocular dataset.
    """
    inverse = np.interp(_grey() * 255, [0, 88, 188, 255], [0, 0.068, 0.464, 1])
    return Response(inverse, model={"name": "tum_narrow"})


RESPONSES: dict[str, Callable[[], Response]] = {
    "linear": linear,
    "srgb": srgb,
    "gamma2.2": gamma22,
    "log": logarithmic,
    "filmic": filmic,
    "tum_narrow": tum_narrow,
}
"""The responses by name."""


def make_response(choice: str | Path | Response) -> Response:
    """Return the response of a name or of a file, or the response itself.

    Raises
    ------
    SettingError
        If it is neither the name of a response nor a file.
    FormatError
        If the file is not a pcalib.txt.
    """
    if isinstance(choice, Response):
        return choice
    if str(choice) in RESPONSES:
        return RESPONSES[str(choice)]()
    if not Path(choice).is_file():
        raise SettingError(f"response '{choice}' is neither a file nor one of {', '.join(RESPONSES)}")
    return read_pcalib(choice)


def _grey() -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.linspace(0.0, 1.0, LEVELS)
