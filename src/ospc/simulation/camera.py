"""The simulated camera: frames in memory, or a recording on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import Float32Array, Image
from ospc.errors import SettingError
from ospc.recording.frame import Frame
from ospc.simulation.files import image_writer, remove_recording, write_truth
from ospc.simulation.motion import Motion
from ospc.simulation.rendering import radiance
from ospc.simulation.scene import Scene
from ospc.simulation.sensor import Sensor
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.truth import Truth, plan, view_at

_DEFAULT = SimulationSettings()


@dataclass(frozen=True)
class SimulatedRecording(Truth):
    """A simulated recording in a folder, in the layout of the TUM monocular dataset, with its truth."""

    path: Path


def frames(settings: SimulationSettings = _DEFAULT) -> Iterator[Frame]:
    """Yield the frames of a simulated recording without writing it.

    Their exposures are those of the metadata, as in a recording on disk; the true ones, and the errors, are those of
    :func:`~ospc.simulation.truth.truth`.
    """
    scene = Scene.of(settings)
    known = plan(settings, scene)
    for index, image in enumerate(_images(scene, known)):
        yield Frame.of_array(
            image,
            float(known.metadata_exposures_ms[index]),
            index=index,
            stamp_s=float(known.stamps_s[index]),
            max_grey=settings.max_grey,
        )


def simulate(
    out: str | Path,
    settings: SimulationSettings = _DEFAULT,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> SimulatedRecording:
    """Write a simulated recording and its truth.

    Parameters
    ----------
    out
        Folder to create. It must be empty or missing, unless it holds an earlier simulated recording to overwrite.
    settings
        What to simulate.
    overwrite
        Whether to remove an earlier simulated recording; nothing else is ever removed.
    progress
        Called with the number of frames written and the total.

    Raises
    ------
    SettingError
        If the folder is not empty or cannot be written.
    OspcError
        As :func:`~ospc.simulation.truth.truth`.
    """
    place = Path(out)
    if not overwrite and place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise SettingError(f"{place}: is not an empty folder; choose another, or empty it")
    scene = Scene.of(settings)
    known = plan(settings, scene)
    try:
        if overwrite:
            remove_recording(place)
        place.mkdir(parents=True, exist_ok=True)
        write_truth(place, known)
        with image_writer(place, settings) as write:
            for index, image in enumerate(_images(scene, known)):
                write(index, image)
                if progress is not None:
                    progress(index + 1, settings.frames)
    except OSError as error:
        raise SettingError(f"{place}: cannot be written ({error}); choose another folder") from error
    return SimulatedRecording(**vars(known), path=place)


def irradiances(settings: SimulationSettings = _DEFAULT) -> Iterator[Float32Array]:
    """Yield the irradiance e·V·L of every frame as a share of saturation, before noise and response.

    Each has shape (height, width). For tests, and for what an ideal sensor would record.
    """
    scene = Scene.of(settings)
    yield from _irradiances(scene, plan(settings, scene))


def _images(scene: Scene, known: Truth) -> Iterator[Image]:
    sensor = Sensor(known.response, known.settings)
    for index, irradiance in enumerate(_irradiances(scene, known)):
        yield sensor.expose(irradiance, frame=index, gain=float(known.gains[index]))


def _irradiances(scene: Scene, known: Truth) -> Iterator[Float32Array]:
    settings = known.settings
    attenuation = known.vignette.image()
    motion = Motion.of(settings)
    exposed: Float32Array | None = None
    for index in range(settings.frames):
        if exposed is None or not settings.still:
            exposed = _exposed(scene, settings, motion, float(known.stamps_s[index]), float(known.times_ms[index]))
        factor = known.exposures_ms[index] * known.light[index]
        yield exposed * attenuation * np.float32(factor)


def _exposed(
    scene: Scene, settings: SimulationSettings, motion: Motion, stamp_s: float, time_ms: float
) -> Float32Array:
    """Return the radiance at every pixel, averaged over instants of the exposure for motion blur."""
    count = settings.motion_blur_samples
    instants = stamp_s + ((np.arange(count) + 0.5) / count - 0.5) * time_ms / 1000
    total = radiance(scene, view_at(settings, motion, instants[0]), instants[0])
    for instant in instants[1:]:
        total += radiance(scene, view_at(settings, motion, instant), instant)
    return total / np.float32(count)
