"""The good recordings that faults are put on: simulated ones of several cameras, and the real video."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ospc.arrays import Float32Array, Image
from ospc.calibrator import calibrate
from ospc.errors import NotObservableError
from ospc.recording import open_recording
from ospc.research.accuracy.design import accuracy_sources
from ospc.research.accuracy.real_video import VideoSource
from ospc.research.faults.footage import Camera, Footage
from ospc.research.source import SimulatedSource
from ospc.research.store import key_of
from ospc.simulation import Truth, irradiances
from ospc.simulation import truth as simulated_truth
from ospc.simulation.sensor import Sensor

SIZE = (320, 240)
"""Size of the simulated images: large enough for errors far below the limits, small enough for thousands of runs."""

_FIRST, _STEP = 7, 5
"""Recordings are taken from the accuracy benchmark's in such steps, so that the first ones differ in response,
vignette, noise and scene."""

GoodSource = SimulatedSource | VideoSource


def good_sources(count: int, frames: int, data: Path | None = None) -> tuple[list[GoodSource], list[str]]:
    """Return ``count`` simulated recordings, the real video if there is one, and notes on what is left out."""
    simulated = [source for source in accuracy_sources(None, frames)[0] if isinstance(source, SimulatedSource)]
    moving = [source for source in simulated if source.group == "simulated"]
    chosen = (moving[(_FIRST + _STEP * i) % len(moving)] for i in range(count))
    sources: list[GoodSource] = [
        replace(source, settings=replace(source.settings, size=SIZE), with_pairs=False) for source in chosen
    ]
    if data is None:
        return sources, ["--data is not given: no real video"]
    real, _ = accuracy_sources(data, frames)
    videos = [replace(source, most_frames=None) for source in real if isinstance(source, VideoSource)]
    return [*sources, *videos], [] if videos else [f"{data} holds no real video"]


_last: dict[str, Footage] = {}
"""The recording that was made last, by its key: faults are put on one recording after the other."""


def good_footage(source: GoodSource) -> Footage:
    """Return a recording without faults, kept in memory until another is asked for."""
    key = key_of(source.describe())
    if key not in _last:
        _last.clear()
        _last[key] = _simulated(source) if isinstance(source, SimulatedSource) else _filmed(source)
    return _last[key]


def _simulated(source: SimulatedSource) -> Footage:
    known: Truth = simulated_truth(source.settings)
    sensor = Sensor(known.response, source.settings)
    light = np.stack(list(irradiances(source.settings)))

    def expose(irradiance: Float32Array, frame: int) -> Image:
        return sensor.expose(irradiance, frame=frame, gain=float(known.gains[frame]))

    return Footage(
        tuple(expose(irradiance, i) for i, irradiance in enumerate(light)),
        known.metadata_exposures_ms,
        known.stamps_s,
        _names(len(light)),
        Camera(light, known.exposures_ms, known.vignette.image(), expose),
        (known.response,),
        known.vignette,
    )


def _filmed(source: VideoSource) -> Footage:
    """Return the real video; its truth is what it gives without faults, and its vignette is unknown."""
    recording = open_recording(source.path)
    frames = list(recording)
    response = calibrate(recording).response
    if response is None:
        raise NotObservableError(f"{source.path}: gives no response without any fault; faults cannot be judged by it")

    def expose(irradiance: Float32Array, _frame: int) -> Image:
        return np.rint(response(np.clip(irradiance, 0, 1)) * 255).astype(np.uint8)

    light = np.stack([response.inverse(frame.image_8_bit / 255).astype(np.float32) for frame in frames])
    exposures = np.array([frame.exposure_ms for frame in frames])
    return Footage(
        tuple(frame.image_8_bit for frame in frames),
        exposures,
        np.array([frame.stamp_s for frame in frames]),
        _names(len(frames)),
        Camera(light, exposures, np.ones(light.shape[1:], np.float32), expose),
        (response,),
    )


def _names(count: int) -> tuple[str, ...]:
    return tuple(f"{i:05d}" for i in range(count))
