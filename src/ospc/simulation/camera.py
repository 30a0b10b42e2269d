"""The simulated camera: render frames in memory, or write a recording to disk."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import Float32Array, Image
from ospc.errors import SettingError, path_of
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.formats.image_files import encoded
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.recording.image_source import decode_grey
from ospc.recording.writing.images import NumberedImages
from ospc.simulation.motion import Motion
from ospc.simulation.rendering import radiance
from ospc.simulation.scene import Scene
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.truth import Truth, truth, view_at
from ospc.system.folders import Content, check_usable, writing

_IMAGE = re.compile(r"\d{5,}\.(png|jpg)")
_FILES = (
    "times.txt", "camera.txt", "groundtruthSync.txt", "truth.json", "pcalib.txt", "vignette.png", "images.zip",
)  # fmt: skip


def _write_truth(folder: Path, known: Truth) -> None:
    """Write times.txt, camera.txt, groundtruthSync.txt, truth.json, and the true pcalib.txt and vignette.png."""
    width, height = known.settings.size
    focal, size = f"{known.settings.focal_px:.9g}", f"{width} {height}"
    times = enumerate(zip(known.stamps_s, known.metadata_exposures_ms, strict=True))
    rows = np.column_stack([known.stamps_s, known.trajectory])
    texts = {
        "times.txt": [f"{i:05d} {stamp:.9f} {e:.9g}" for i, (stamp, e) in times],
        "camera.txt": [f"Pinhole {focal} {focal} {(width - 1) / 2} {(height - 1) / 2} 0", size, "none", size],
        "groundtruthSync.txt": [" ".join(f"{value:.9f}" for value in row) for row in rows],
        "truth.json": [json.dumps(known.as_dict(), indent=1, allow_nan=False)],
    }
    for name, lines in texts.items():
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    write_pcalib(known.response, folder / "pcalib.txt")
    write_vignette(known.vignette, folder / "vignette.png")


def _content(folder: Path) -> Content:
    if not (folder / "truth.json").is_file():
        return Content("is not an empty folder, and not a simulated recording (it has no truth.json)", "never")
    images = folder / "images"
    inside = images.iterdir() if images.is_dir() else ()
    foreign = {*folder.iterdir(), *inside} - {images, *_written(folder)}
    if foreign:
        return Content(f"contains {min(foreign).name}, which no simulation wrote", "never")
    return Content("contains a simulated recording", "with force")


def _written(folder: Path) -> list[Path]:
    """Return the files of a simulated recording."""
    files = [folder / name for name in _FILES if (folder / name).is_file()]
    images = folder / "images"
    return files + [path for path in (images.iterdir() if images.is_dir() else ()) if _IMAGE.fullmatch(path.name)]


_TABLE = 2**16
"""Entries of the table of 8-bit grey values: indices fit 16 bits, and errors are far below a grey level."""


class Sensor:
    """Converts irradiance to grey values, M = f(I + noise).

    The noise consists of shot and read noise. With gain G, full well F and read noise r, an irradiance I (saturation
    is 1) corresponds to I·F/G electrons, whose count has variance I·F/G + r². It is drawn from a normal distribution,
    which approximates a Poisson distribution above about ten electrons.
    """

    def __init__(self, response: Response, settings: SimulationSettings) -> None:
        self._response, self._max_grey, self._seed = response, settings.max_grey, settings.seed
        self._full_well, self._read_noise = settings.sensor
        # Tabulated over the square root of the irradiance, because responses are steep near zero irradiance.
        root = np.linspace(0.0, 1.0, _TABLE)
        self._grey = np.rint(response(root**2) * 255).astype(np.uint8)

    def expose(self, irradiance: Float32Array, *, frame: int, gain: float = 1.0) -> Image:
        """Return the uint8 or uint16 image of an irradiance e V L relative to saturation, shape (height, width).

        The index of the frame seeds the noise; e includes the linear gain.
        """
        if math.isfinite(self._full_well):
            rng = np.random.default_rng([self._seed, 3, frame])
            noise = rng.standard_normal(irradiance.shape, dtype=np.float32)
            electrons = np.maximum(irradiance, 0) * np.float32(self._full_well / gain)
            noise *= np.sqrt(electrons + np.float32(self._read_noise**2)) * np.float32(gain / self._full_well)
            irradiance = irradiance + noise
        exposed = np.clip(irradiance, 0, 1)
        if self._max_grey > 255:
            return np.rint(self._response(exposed) * self._max_grey).astype(np.uint16)
        index = np.sqrt(exposed) * np.float32(_TABLE - 1) + np.float32(0.5)
        return np.take(self._grey, index.astype(np.uint16))


_DEFAULT = SimulationSettings()


@dataclass(frozen=True)
class SimulatedRecording(Truth):
    """A simulated recording in a folder, in the layout of the TUM monocular data set, with its truth."""

    path: Path


def frames(settings: SimulationSettings = _DEFAULT, known: Truth | None = None) -> Iterator[Frame]:
    """Yield the frames of a simulated recording without writing it; those of JPEG files have their errors.

    Their exposures are those in the metadata, as in a recording on disk; :func:`~ospc.simulation.truth.truth` returns
    the true ones. Its result for the same settings may be passed as ``known``, to avoid simulating auto exposure
    again.
    """
    known = known or truth(settings)
    for index, exposed in enumerate(_images(known)):
        as_file = settings.image_format == "jpg"
        image = decode_grey(_file(exposed, index, settings), _name(index)) if as_file else exposed
        stated_ms, stamp_s = float(known.metadata_exposures_ms[index]), float(known.stamps_s[index])
        yield Frame.of_array(image, stated_ms, index=index, stamp_s=stamp_s, max_grey=settings.max_grey)


def simulate(
    out: str | Path,
    settings: SimulationSettings = _DEFAULT,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> SimulatedRecording:
    """Write a simulated recording and its truth.

    Parameters
    ----------
    out
        Folder to create. It must be empty or missing, unless it contains an earlier simulated recording to overwrite.
    settings
        Camera, scene, motion and exposures.
    overwrite
        Whether to remove an earlier simulated recording; nothing else is ever removed.
    progress
        Called with the number of frames written and the total.

    Raises
    ------
    SettingError
        If the folder is not empty or cannot be written, or the response or vignette does not exist.
    FormatError
        If a response or vignette file cannot be read.
    """
    place = path_of(out, SettingError, "the folder of a simulated recording")
    if not isinstance(settings, SimulationSettings):
        raise SettingError(f"settings must be SimulationSettings, not {type(settings).__name__}")
    check_usable(place, content_of=_content, force=overwrite)
    known = truth(settings)
    with writing(place):
        for path in _written(place):  # those of an earlier simulated recording
            path.unlink()
        if (place / "images").is_dir():
            (place / "images").rmdir()
        place.mkdir(parents=True, exist_ok=True)
        _write_truth(place, known)
        with NumberedImages(place, settings.frames, archive=settings.archive) as images:
            for index, image in enumerate(_images(known)):
                images.write(index, _file(image, index, settings))
                progress(index + 1, settings.frames)
    return SimulatedRecording(**vars(known), path=place)


def irradiances(settings: SimulationSettings = _DEFAULT, known: Truth | None = None) -> Iterator[Float32Array]:
    """Yield the irradiance e·V·L of every frame relative to saturation, before noise and response.

    This is what an ideal sensor would record. Each array has shape (height, width). For ``known``, see
    :func:`frames`.
    """
    known = known or truth(settings)
    scene, motion = Scene.of(settings), Motion.of(settings)
    attenuation = known.vignette.image()
    exposed: Float32Array | None = None
    for index in range(settings.frames):
        if exposed is None or not settings.stationary:
            exposed = _exposed(scene, known, motion, index)
        factor = known.exposures_ms[index] * known.light[index]
        yield exposed * attenuation * np.float32(factor)


def _name(index: int) -> str:
    return f"image {index}"


def _file(image: Image, index: int, settings: SimulationSettings) -> bytes:
    return encoded(image, f".{settings.image_format}", _name(index), jpeg_quality=settings.jpg_quality)


def _images(known: Truth) -> Iterator[Image]:
    sensor = Sensor(known.response, known.settings)
    for index, irradiance in enumerate(irradiances(known.settings, known)):
        yield sensor.expose(irradiance, frame=index, gain=float(known.gains[index]))


def _exposed(scene: Scene, known: Truth, motion: Motion, index: int) -> Float32Array:
    """Return the radiance at every pixel, averaged over instants during the exposure to simulate motion blur."""
    settings, count = known.settings, known.settings.motion_blur_samples
    instants = known.stamps_s[index] + ((np.arange(count) + 0.5) / count - 0.5) * known.times_ms[index] / 1000
    views = (radiance(scene, view_at(settings, motion, instant), instant) for instant in instants)
    return np.asarray(sum(views) / np.float32(count))
