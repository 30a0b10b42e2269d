"""What experiments are made on: a given recording with its truth, or simulated stand-ins for the paper's.

The stand-ins are filmed with the response and the vignette of the data set's narrow camera and with exposures of a
real recording, where a folder of reference data holds them; with an analytic approximation of both, and exposures as
an automatic control sets them, where it does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError, SettingError
from ospc.formats.dso import read_pcalib
from ospc.formats.files import read_text
from ospc.formats.opening import Photometry
from ospc.odometry.calibrations import true_photometry
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, Vignette
from ospc.recording import Frame, open_recording
from ospc.simulation import SimulationSettings
from ospc.simulation import frames as simulated_frames
from ospc.simulation.responses import make_response
from ospc.simulation.vignettes import make_vignette

RESPONSE, VIGNETTE = "params/pcalib_narrow_DIGITISED.txt", "params/vignette_narrow_radial_DIGITISED.csv"
EXPOSURES = "params/tum_vi_times.txt"

ANALYTIC_VIGNETTE = (-0.35, 0.05, -0.15)
_SEED = 3000
_FEWEST_RADII = 8
_MOST_BYTES = 16_000_000


@dataclass(frozen=True)
class Source:
    """A recording with its truth.

    Attributes
    ----------
    name
        What to call it.
    count
        Number of its frames.
    truth
        True response and vignette.
    open
        Gives its frames from the beginning, every time it is called.
    """

    name: str
    count: int
    truth: Photometry
    open: Callable[[], Iterator[Frame]] = field(repr=False)


def given(path: Path, frames: int | None = None) -> Source:
    """Return a recording in the layout of the TUM monocular data set, with its pcalib.txt and vignette.png as truth.

    Parameters
    ----------
    path
        Its folder.
    frames
        Most frames to use; all where None.

    Raises
    ------
    OspcError
        If it cannot be opened or has no truth.
    """
    recording = open_recording(path)
    count = len(recording) if frames is None else min(frames, len(recording))
    return Source(path.resolve().name, count, true_photometry(recording), lambda: islice(iter(recording), count))


def stand_ins(
    count: int, frames: int, size: ImageSize, data: Path | None = None, *, speed: float = 1.0
) -> list[Source]:
    """Return simulated recordings: each another scene, motion and course of exposures.

    Parameters
    ----------
    count
        How many.
    frames
        Frames of each.
    size
        Width and height of the images.
    data
        Folder of reference data; None for the analytic camera.
    speed
        Factor on the speed of the camera's motion.

    Raises
    ------
    SettingError
        If none are asked for.
    FormatError
        If a file of the folder does not hold what it should.
    """
    if count < 1 or frames < 2:
        raise SettingError("an experiment needs a recording at least, of two frames or more")
    response, vignette = _camera(size, data)
    courses = _courses(count, frames, data)
    common = SimulationSettings(
        size=size,
        frames=frames,
        speed=speed,
        response=response,
        vignette=vignette,
        vignette_coefficients=ANALYTIC_VIGNETTE,
    )
    return [_stand_in(number, common, courses) for number in range(count)]


def _stand_in(number: int, common: SimulationSettings, courses: list[FloatArray] | None) -> Source:
    settings = replace(common, seed=_SEED + number)
    if courses is not None:
        middle = float(np.exp(np.mean(np.log(courses[number]))))
        exposures = tuple(courses[number].tolist())
        settings = replace(settings, exposure="file", exposures_ms=exposures, reference_exposure_ms=middle)
    truth = Photometry(f"truth {number}", make_response(settings.response), make_vignette(settings))
    return Source(f"simulated-{number}", settings.frames, truth, lambda: simulated_frames(settings))


def _camera(size: ImageSize, data: Path | None) -> tuple[str | Response, str | Vignette]:
    """Return response and vignette of the narrow camera, or names of analytic ones."""
    if data is None or not (data / RESPONSE).is_file() or not (data / VIGNETTE).is_file():
        return "tum_narrow", "polynomial"
    return read_pcalib(data / RESPONSE), _radial(data / VIGNETTE, size)


def _radial(path: Path, size: ImageSize) -> PolynomialVignette:
    """Return 1 + v₁R² + v₂R⁴ + v₃R⁶ nearest to a table 'radius,V'.

    The table was read off a published picture, whose line is unsteady where it is nearly level; as it stands it would
    have a dip in its middle that no lens has.
    """
    try:
        rows = [line.split(",") for line in read_text(path, _MOST_BYTES).splitlines() if line[:1].isdigit()]
        radius, value = np.array(rows, dtype=np.float64).T
    except ValueError:
        raise FormatError(f"{path}: is not a table 'radius,V' with one row a line") from None
    if radius.size < _FEWEST_RADII or not np.all(np.isfinite(value)) or np.any(np.diff(radius) <= 0):
        raise FormatError(f"{path}: needs finite values at {_FEWEST_RADII} or more increasing radii")
    scale, *terms = np.linalg.lstsq(radius[:, None] ** (2 * np.arange(4)), value, rcond=None)[0].tolist()
    return PolynomialVignette(size, tuple(term / scale for term in terms))


def _courses(count: int, frames: int, data: Path | None) -> list[FloatArray] | None:
    """Return the liveliest parts of a real course of exposures, which do not overlap as far as there are enough."""
    if data is None or not (data / EXPOSURES).is_file():
        return None
    place = data / EXPOSURES
    try:
        lines = [line for line in read_text(place, _MOST_BYTES).splitlines() if not line.startswith("#")]
        exposures = np.array([float(line.split()[-1]) for line in lines if line.strip()])
    except ValueError:
        raise FormatError(f"{place}: does not end every line with an exposure") from None
    if exposures.size < frames or not np.all(np.isfinite(exposures) & (exposures > 0)):
        raise FormatError(f"{place}: needs {frames} positive exposures; simulate fewer frames")
    whole = exposures.size // frames
    starts = np.arange(whole) * frames
    if whole < count:
        starts = np.linspace(0, exposures.size - frames, count).astype(int)
    parts = [exposures[start : start + frames] for start in starts]
    return sorted(parts, key=lambda part: -float(np.std(np.log(part))))[:count]
