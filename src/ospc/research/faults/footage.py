"""The good recordings that faults are added to, in memory: simulated ones and the real video."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias
from zlib import crc32

import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image
from ospc.calibrator import calibrate
from ospc.errors import NotObservableError
from ospc.photometry.calibration import Calibration
from ospc.photometry.geometry import pixel_grid
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette
from ospc.recording import open_recording
from ospc.research.accuracy.design import moving_sources
from ospc.research.accuracy.real_video import VIDEO, VideoSource
from ospc.research.runner import key_of
from ospc.research.source import SimulatedSource
from ospc.simulation import Truth, irradiances
from ospc.simulation import truth as simulated_truth
from ospc.simulation.camera import Sensor

STRENGTHS = ("weak", "medium", "strong")
"""The three strengths of every fault."""
Strengths: TypeAlias = tuple[float, float, float]
"""Their values, in the unit of the fault's description."""


@dataclass(frozen=True)
class Camera:
    """How the images were formed, so that a fault can act on the light before the sensor.

    ``irradiance`` is the noise-free e·V·L of every frame, with saturation at 1, shape (frames, height, width);
    ``attenuation`` is V at every pixel, shape (height, width). ``expose`` turns the irradiance of a frame, given with
    its number, into an image with noise, response and quantisation.
    """

    irradiance: Float32Array
    exposures_ms: FloatArray
    attenuation: Float32Array
    expose: Callable[[Float32Array, int], Image] = field(repr=False)

    def radiance(self, frame: int) -> Float32Array:
        """Return L at every pixel of a frame, in saturation levels per millisecond."""
        return np.asarray(self.irradiance[frame] / (self.attenuation * np.float32(self.exposures_ms[frame])))


@dataclass(frozen=True)
class Footage:
    """A recording in memory: 8-bit images with their metadata and ids, such as "00012".

    Attributes
    ----------
    responses
        The responses that count as true. A fault that applies one curve to all grey values has two: the camera's, if
        the estimate undoes the curve, and the camera's with the curve, if it does not.
    vignette
        The true vignette; None if unknown.
    max_radius, brightest
        Largest radius, in half diagonals, at which the images show the scene, and largest grey level, of 1, that they
        can have; vignette and response are judged up to there.
    reference
        The calibration that found the true response of the real video, which has an uncertainty, too; None if the
        truth is exact.
    times
        Lines of ``times.txt``, for faults that only a file can have. The recording is then read from files.
    power
        The exposures in the metadata are (nearly) proportional to this power of the true ones.
    random
        Generator for random changes, seeded by the fault.
    """

    images: tuple[Image, ...]
    exposures_ms: FloatArray
    stamps_s: FloatArray
    names: tuple[str, ...]
    camera: Camera = field(repr=False)
    responses: tuple[Response, ...] = field(repr=False)
    vignette: Vignette | None = None
    max_radius: float = 1.0
    brightest: float = 1.0
    reference: Calibration | None = field(default=None, repr=False)
    times: tuple[str, ...] = ()
    power: float = 1.0
    random: np.random.Generator = field(default_factory=np.random.default_rng, repr=False, compare=False)

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.images)

    @property
    def half(self) -> int:
        """Index of the first frame of the second half."""
        return len(self) // 2

    def from_centre(self) -> FloatArray:
        """Return the positions (x, y) of all pixels relative to the image centre, shape (height, width, 2)."""
        height, width = self.images[0].shape
        return np.asarray(pixel_grid((width, height)) - [(width - 1) / 2, (height - 1) / 2])

    def with_images(self, images: Iterable[Image]) -> Footage:
        """Return the recording with other images."""
        return replace(self, images=tuple(images))

    def with_exposures(self, exposures_ms: FloatArray) -> Footage:
        """Return the recording with other exposures in its metadata."""
        return replace(self, exposures_ms=np.asarray(exposures_ms, dtype=np.float64))

    def as_stated(self) -> Footage:
        """Return the recording with the truth of a camera that takes the same images at the stated exposures.

        Raising radiances, response and vignette to the same power as the exposures leaves every image unchanged.
        """
        responses = tuple(Response.from_values(one.inverse_table**self.power) for one in self.responses)
        vignette = None if self.vignette is None else RasterVignette(self.vignette.image() ** self.power)
        return replace(self, responses=responses, vignette=vignette, power=1.0)

    def relit(self, change: Callable[[Float32Array, int], npt.NDArray[Any]]) -> Footage:
        """Return the recording that the camera takes if a function changes the irradiance of every frame."""
        lights = enumerate(self.camera.irradiance)
        return self.with_images(
            self.camera.expose(np.asarray(change(light, i), np.float32), i) for i, light in lights
        )

    def chosen(self, frames: BoolArray) -> Footage:
        """Return some of the frames, with their own metadata."""
        kept = np.flatnonzero(frames)
        images, names = tuple(self.images[i] for i in kept), tuple(self.names[i] for i in kept)
        left = replace(self, images=images, names=names, stamps_s=self.stamps_s[kept])
        return left.with_exposures(self.exposures_ms[kept])

    def some(self, share: float) -> BoolArray:
        """Return a mask of a random share of the frames, at least one and never the first, shape (frames,)."""
        mask, others = np.zeros(len(self), bool), len(self) - 1
        mask[1 + self.random.choice(others, min(others, max(1, round(share * len(self)))), replace=False)] = True
        return mask

    def blocks(self, length: int) -> FloatArray:
        """Return +1 or −1, drawn at random for each block of ``length`` frames, shape (frames,)."""
        return np.repeat(self.random.choice([-1.0, 1.0], len(self) // length + 1), length)[: len(self)]

    def wave(self, cycles: float) -> FloatArray:
        """Return a sine with this number of cycles over the recording, shape (frames,)."""
        return np.sin(2 * np.pi * cycles * np.arange(len(self)) / len(self))


@dataclass(frozen=True)
class Fault:
    """A kind of fault: its name, a description with {} for the strength, and the function that applies it."""

    name: str
    text: str
    strengths: Strengths
    change: Callable[[Footage, float], Footage] = field(repr=False)

    def put_on(self, footage: Footage, strength: float) -> Footage:
        """Return a recording with the fault; deterministic."""
        return self.change(replace(footage, random=np.random.default_rng(crc32(self.name.encode()))), strength)

    def in_words(self, strength: float) -> str:
        """Return the description for a strength."""
        return self.text.format(f"{strength:g}")


SIZE = (320, 240)
"""Size of the simulated images: large enough for errors far below the limits, small enough for thousands of runs."""
_FIRST, _STEP = 7, 5
"""First and step of the accuracy benchmark's recordings used here: the first few differ in response, vignette, noise
and scene."""

GoodSource = SimulatedSource | VideoSource


def good_sources(count: int, frames: int, data: Path | None = None) -> tuple[list[GoodSource], list[str]]:
    """Return ``count`` simulated recordings, the real video if available, and notes on what is left out."""
    moving = list(moving_sources(None, frames))
    chosen = (moving[(_FIRST + _STEP * i) % len(moving)] for i in range(count))
    sources: list[GoodSource] = [
        replace(source, settings=replace(source.settings, size=SIZE), with_pairs=False) for source in chosen
    ]
    if data is None:
        return sources, ["--data is not given: no real video"]
    if not (data / VIDEO).exists():
        return sources, [f"{data} contains no real video"]
    return [*sources, VideoSource(VIDEO, data / VIDEO, most_frames=None)], []


_SATURATED, _SATURATED_FROM = 1.16, 246
"""Irradiance of saturated pixels of the real video, relative to white, and the lowest grey value that counts as
saturated: its white is not 255 but accumulates at 249, with noise of two levels. Only frames of 32 ms have them. With
this irradiance, their mean is twice that of the frames of 16 ms before them, as for all shorter exposures."""
_GREY_NOISE = 0.5
"""Noise of images made from the real video, in grey values. They contain the noise of its frames, but a frame that is
shown again at the same exposure would have the same rounding errors."""
_last: dict[str, Footage] = {}
"""Cache of the latest recording, by its key: the study takes one recording after the other."""


def good_footage(source: GoodSource) -> Footage:
    """Return a recording without faults; the latest one is cached."""
    key = key_of(source.describe())
    if key not in _last:
        _last.clear()
        _last[key] = _simulated(source) if isinstance(source, SimulatedSource) else _filmed(source)
    return _last[key]


def _simulated(source: SimulatedSource) -> Footage:
    known: Truth = simulated_truth(source.settings)
    sensor = Sensor(known.response, source.settings)
    light = np.stack(list(irradiances(source.settings, known)))

    def expose(irradiance: Float32Array, frame: int) -> Image:
        return sensor.expose(irradiance, frame=frame, gain=float(known.gains[frame]))

    camera = Camera(light, known.exposures_ms, known.vignette.image(), expose)
    images = tuple(expose(irradiance, i) for i, irradiance in enumerate(light))
    stated = (known.metadata_exposures_ms, known.stamps_s, _names(len(light)))
    return Footage(images, *stated, camera, (known.response,), known.vignette)


def _filmed(source: VideoSource) -> Footage:
    """Return the real video. Its truth is the calibration without faults; its vignette is unknown."""
    recording = open_recording(source.path)
    frames = list(recording)
    reference = calibrate(recording)
    response = reference.response
    if response is None:
        raise NotObservableError(f"{source.path}: yields no response even without faults, so faults cannot be judged")

    def expose(irradiance: Float32Array, frame: int) -> Image:
        grey = response(np.clip(irradiance, 0, 1)) * 255
        noisy = np.rint(grey + _GREY_NOISE * np.random.default_rng(frame).standard_normal(grey.shape))
        return np.clip(noisy, 0, 255).astype(np.uint8)

    images = tuple(frame.image_8_bit for frame in frames)
    greys = np.arange(256)
    light_of_grey = np.where(greys >= _SATURATED_FROM, _SATURATED, response.inverse(greys / 255)).astype(np.float32)
    light = light_of_grey[np.stack(images)]
    exposures, stamps = np.array([(frame.exposure_ms, frame.stamp_s) for frame in frames]).T
    camera = Camera(light, exposures, np.ones(light.shape[1:], np.float32), expose)
    return Footage(images, exposures, stamps, _names(len(frames)), camera, (response,), reference=reference)


def _names(count: int) -> tuple[str, ...]:
    return tuple(f"{i:05d}" for i in range(count))
