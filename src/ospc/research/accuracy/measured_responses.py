"""Responses measured on real film and cameras: the database of response functions (Grossberg and Nayar 2003)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError
from ospc.photometry.response import Response
from ospc.simulation.responses import LEVELS

FILE = "responses/dorf_201.mat"
"""Place of the database in the folder of real data."""

_MAX_FILE_BYTES = 64 * 2**20
_MAX_VALUES = 5_000_000
_FLATTEST = 1e-6
"""Least growth of g over its table where a measured curve is a step; small against any noise."""


def read_database(path: str | Path) -> list[Response]:
    """Read the curves of a MATLAB file with irradiances ``I`` and brightnesses ``B``, one curve a row.

    Raises
    ------
    FormatError
        If the file cannot be read, or does not hold such curves.
    """
    place = Path(path)
    irradiance, brightness = _arrays(place)
    if irradiance.ndim != 2 or irradiance.shape != brightness.shape or irradiance.shape[1] < 2:
        raise FormatError(f"{place}: I and B have shapes {irradiance.shape} and {brightness.shape}; both need (n, m)")
    return [
        _response(i, b, f"{place}, curve {number}")
        for number, (i, b) in enumerate(zip(irradiance, brightness, strict=True))
    ]


def _arrays(place: Path) -> tuple[FloatArray, FloatArray]:
    """Return the arrays I and B; the file states their sizes before anything is unpacked."""
    from scipy.io import loadmat, whosmat

    try:
        if place.stat().st_size > _MAX_FILE_BYTES:
            raise FormatError(f"{place}: too large for a database of responses; give a .mat file with I and B")
        sizes = {name: math.prod(shape) for name, shape, _ in whosmat(place)}
        if max(sizes["I"], sizes["B"]) > _MAX_VALUES:
            raise FormatError(
                f"{place}: I and B hold more than {_MAX_VALUES} values; that is no database of responses"
            )
        content = loadmat(place, variable_names=["I", "B"])
        irradiance, brightness = (np.asarray(content[name], dtype=np.float64) for name in ("I", "B"))
    except FormatError:
        raise
    except Exception as error:  # the reader has no error of its own for damaged files
        raise FormatError(f"{place}: not readable as a database of responses ({error}); it needs I and B") from None
    return irradiance, brightness


def _response(irradiance: FloatArray, brightness: FloatArray, name: str) -> Response:
    """Return g, irradiance as a function of brightness.

    Where a curve is flat at black or white, g starts at the last irradiance that is still black and ends at the first
    that is white.
    """
    if not np.all(np.isfinite([irradiance, brightness])) or np.any(np.diff(brightness) < 0):
        raise FormatError(f"{name}: brightness must be finite and must not decrease")
    low = int(np.flatnonzero(brightness <= brightness[0])[-1])
    high = int(np.flatnonzero(brightness >= brightness[-1])[0])
    if high <= low or np.any(np.diff(irradiance) <= 0):
        raise FormatError(f"{name}: irradiance must increase, and brightness with it")
    span = brightness[low : high + 1]
    # The tiny ramp keeps equal brightnesses in order for the interpolation.
    grey = (span - span[0]) / (span[-1] - span[0]) + np.arange(len(span)) * 1e-12
    g = np.interp(np.linspace(0, grey[-1], LEVELS), grey, irradiance[low : high + 1])
    return Response.from_values(
        g + np.linspace(0, _FLATTEST, LEVELS), model={"name": "measured", "curve": name.rpartition(" ")[2]}
    )
