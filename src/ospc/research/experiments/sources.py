"""The recordings of experiments: stand-ins for the paper's, and exposure sweeps.

With a folder of reference data, stand-ins have the response and vignette of the data set's narrow camera and the
exposures of a real recording; without it, analytic approximations and simulated auto exposure.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError
from ospc.formats.dso import read_pcalib
from ospc.formats.files import read_text
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, Vignette
from ospc.recording.table_text import exposures_in
from ospc.research.source import SWEEP, SimulatedSource
from ospc.simulation import SimulationSettings

RESPONSE, VIGNETTE = "params/pcalib_narrow_DIGITISED.txt", "params/vignette_narrow_radial_DIGITISED.csv"
EXPOSURES = "params/tum_vi_times.txt"

STATIC_RESPONSES = ("linear", "srgb", "gamma2.2", "log", "filmic", "tum_narrow")
"""Responses of the static cameras, in turn."""
_SEED, _STATIC_SEED = 3000, 4000
_FEWEST_RADII = 8
"""Fewest radii in a vignette table: twice the number of coefficients."""

_MOST_BYTES = 64_000_000


def stand_ins(
    count: int, frames: int, size: ImageSize, data: Path | None = None, *, speed: float = 1.0
) -> list[SimulatedSource]:
    """Return simulated recordings, each with its own scene, motion and exposures.

    ``data`` is the folder of reference data, and ``speed`` a factor on the camera's speed.
    """
    response: str | Response = "tum_narrow"
    vignette: str | Vignette = "polynomial"
    if data is not None and (data / RESPONSE).is_file() and (data / VIGNETTE).is_file():
        response, vignette = read_pcalib(data / RESPONSE), _radial(data / VIGNETTE, size)
    courses = _courses(count, frames, data)
    common = SimulationSettings(size=size, frames=frames, speed=speed, response=response, vignette=vignette)
    found = []
    for number in range(count):
        settings = replace(common, seed=_SEED + number)
        if courses is not None:
            middle = float(np.exp(np.mean(np.log(courses[number]))))
            exposures = tuple(courses[number].tolist())
            settings = replace(settings, exposure="file", exposures_ms=exposures, reference_exposure_ms=middle)
        found.append(SimulatedSource(f"simulated-{number}", settings))
    return found


def sweeps(count: int, frames: int, size: ImageSize) -> list[SimulatedSource]:
    """Return exposure sweeps of static cameras with different responses."""
    found = []
    for number in range(count):
        response = STATIC_RESPONSES[number % len(STATIC_RESPONSES)]
        settings = replace(SWEEP, size=size, frames=frames, seed=_STATIC_SEED + number, response=response)
        found.append(SimulatedSource(f"static-{response}-{number}", settings, group="static"))
    return found


def _radial(path: Path, size: ImageSize) -> PolynomialVignette:
    """Fit 1 + v₁R² + v₂R⁴ + v₃R⁶ to a table 'radius,V'."""
    # The table was digitised from a published plot, and its errors near the centre would form a dip that no lens has.
    try:
        rows = [line.split(",") for line in read_text(path, _MOST_BYTES).splitlines() if line[:1].isdigit()]
        radius, value = np.array(rows, dtype=np.float64).T
    except ValueError:
        raise FormatError(f"{path}: is not a table 'radius,V' with one radius per line") from None
    if radius.size < _FEWEST_RADII or not np.all(np.isfinite(value)) or np.any(np.diff(radius) <= 0):
        raise FormatError(f"{path}: needs finite values at {_FEWEST_RADII} or more increasing radii")
    scale, *terms = np.linalg.lstsq(radius[:, None] ** (2 * np.arange(4)), value, rcond=None)[0].tolist()
    return PolynomialVignette(size, tuple(term / scale for term in terms))


def _courses(count: int, frames: int, data: Path | None) -> list[FloatArray] | None:
    """Return the most variable parts of a real exposure sequence; they overlap only if it is too short."""
    if data is None or not (data / EXPOSURES).is_file():
        return None
    place = data / EXPOSURES
    exposures = np.array(exposures_in(place))
    if exposures.size < frames or not np.all(np.isfinite(exposures) & (exposures > 0)):
        raise FormatError(f"{place}: needs {frames} positive exposures; simulate fewer frames")
    whole = exposures.size // frames
    starts = np.arange(whole) * frames
    if whole < count:
        starts = np.linspace(0, exposures.size - frames, count).astype(int)
    parts = [exposures[start : start + frames] for start in starts]
    return sorted(parts, key=lambda part: -float(np.std(np.log(part))))[:count]
