"""The simulated camera: frames in memory, or a recording on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import Float32Array, FloatArray, Image
from ospc.errors import SettingError
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette
from ospc.recording.frame import Frame
from ospc.simulation.files import ImageWriter, remove_recording, write_truth
from ospc.simulation.motion import Motion
from ospc.simulation.rendering import radiance
from ospc.simulation.scene import Scene
from ospc.simulation.sensor import Sensor
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.truth import Truth, plan, view_at

_DEFAULT = SimulationSettings()


@dataclass(frozen=True)
class SimulatedRecording:
    """A recording on disk whose truth is known.

    Attributes
    ----------
    path
        Its folder, in the layout of the TUM monocular dataset.
    truth
        Everything that is true of it.
    """

    path: Path
    truth: Truth

    @property
    def response(self) -> Response:
        """The true response."""
        return self.truth.response

    @property
    def vignette(self) -> Vignette:
        """The true vignette."""
        return self.truth.vignette

    @property
    def exposures_ms(self) -> FloatArray:
        """True exposures, time times gain, shape (frames,); the metadata may say otherwise."""
        return self.truth.exposures_ms

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamps, shape (frames,)."""
        return self.truth.stamps_s

    @property
    def trajectory(self) -> FloatArray:
        """Rows (tx, ty, tz, qx, qy, qz, qw), camera to world, shape (frames, 7)."""
        return self.truth.trajectory


def frames(settings: SimulationSettings = _DEFAULT) -> Iterator[Frame]:
    """Give the frames of a simulated recording in memory, one by one.

    Their exposures are those of the metadata, as a recording on disk gives them; :func:`truth` has the true ones.

    Raises
    ------
    SettingError
        If response or vignette are not what the settings may name.
    FormatError
        If they come from a file that does not hold them.
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
        Folder to make; it must not exist or be empty, or else hold an earlier simulated recording to overwrite.
    settings
        What to simulate.
    overwrite
        Whether to remove an earlier simulated recording; anything else is never removed.
    progress
        Called with the number of frames written and of all frames.

    Returns
    -------
    SimulatedRecording
        Where it is and what is true of it.

    Raises
    ------
    SettingError
        If the folder is not empty or cannot be written, or response or vignette are not what the settings may name.
    FormatError
        If response or vignette come from a file that does not hold them.
    """
    place = Path(out)
    if not overwrite and place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise SettingError(f"{place}: is not an empty folder; choose another, or remove what is there")
    scene = Scene.of(settings)
    known = plan(settings, scene)
    try:
        if overwrite:
            remove_recording(place)
        place.mkdir(parents=True, exist_ok=True)
        write_truth(place, known)
        with ImageWriter(place, settings) as writer:
            for index, image in enumerate(_images(scene, known)):
                writer.write(index, image)
                if progress is not None:
                    progress(index + 1, settings.frames)
    except OSError as error:
        raise SettingError(f"{place}: cannot be written ({error}); choose another folder") from error
    return SimulatedRecording(place, known)


def irradiances(settings: SimulationSettings = _DEFAULT) -> Iterator[Float32Array]:
    """Give the irradiance e·V·L of every frame as a share of saturation, before noise and response.

    Each of shape (height, width); for tests of the simulator and of what a perfect sensor would see.
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
    still = settings.motion == "static" and not settings.moving_objects
    seen: Float32Array | None = None
    for index in range(settings.frames):
        if seen is None or not still:
            seen = _seen(scene, settings, motion, float(known.stamps_s[index]), float(known.times_ms[index]))
        factor = known.exposures_ms[index] * known.light[index]
        yield seen * attenuation * np.float32(factor)


def _seen(scene: Scene, settings: SimulationSettings, motion: Motion, stamp_s: float, time_ms: float) -> Float32Array:
    """Return the radiance at every pixel, averaged over the exposure if motion blurs it."""
    count = settings.motion_blur_samples
    instants = stamp_s + ((np.arange(count) + 0.5) / count - 0.5) * time_ms / 1000
    total = radiance(scene, view_at(settings, motion, instants[0]), instants[0])
    for instant in instants[1:]:
        total += radiance(scene, view_at(settings, motion, instant), instant)
    return total / np.float32(count)
