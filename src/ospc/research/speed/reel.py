"""Frames for speed measurements: a simulated walk of any length."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import Image, ImageSize
from ospc.formats.image_files import encoded
from ospc.recording import Frame
from ospc.recording.image_source import decode_grey

_DISTINCT, _QUALITY = 150, 92
"""Frames simulated and then repeated, because more would cost time and memory; JPEG quality of common cameras."""

_FRAMES_PER_SECOND = 20
_SEED = 7


@dataclass(frozen=True)
class Reel:
    """Grey JPEG frames of a simulated walk with their exposures, played forward and backward."""

    images: tuple[bytes, ...]
    exposures_ms: tuple[float, ...]

    @property
    def megabytes(self) -> float:
        """Memory of the encoded frames, which does not count towards a measurement."""
        return sum(map(len, self.images)) / 2**20

    def place(self, index: int) -> int:
        """Return the number of a frame's image: forward, backward, and forward again."""
        period = max(1, 2 * len(self.images) - 2)
        turn = index % period
        return min(turn, period - turn)

    def frames(self, count: int) -> Iterator[Frame]:
        """Yield this many frames, decoded on use."""
        for index in range(count):
            place = self.place(index)
            name = f"frame {index}"
            load = partial(decode_grey, self.images[place], name)
            stamp_s, exposure_ms = index / _FRAMES_PER_SECOND, self.exposures_ms[place]
            # There is nothing to verify: the images are in memory.
            yield Frame(index, stamp_s, exposure_ms, name, load, verify=lambda: None, threads=True)

    def decoded(self, index: int) -> Image:
        """Return the image of a frame."""
        return np.asarray(cv2.imdecode(np.frombuffer(self.images[self.place(index)], np.uint8), cv2.IMREAD_GRAYSCALE))

    def decoding_s(self, count: int) -> tuple[float, float]:
        """Return the wall-clock and processor time of decoding this many frames in one thread."""
        begun, cpu = time.perf_counter(), time.thread_time()
        for index in range(count):
            self.decoded(index)
        return time.perf_counter() - begun, time.thread_time() - cpu

    def write(self, folder: Path, count: int) -> Path:
        """Write a recording of this many frames and return its path; repeated images are hard links."""
        from ospc.formats.dso import write_times

        images = folder / "images"
        images.mkdir(parents=True)
        for index in range(count):
            place, name = self.place(index), images / f"{index:05}.jpg"
            if index < len(self.images):
                name.write_bytes(self.images[place])
            else:
                os.link(images / f"{place:05}.jpg", name)
        stamps_s = np.arange(count) / _FRAMES_PER_SECOND
        exposures_ms = [self.exposures_ms[self.place(index)] for index in range(count)]
        write_times(folder / "times.txt", range(count), stamps_s, exposures_ms)
        return folder


@lru_cache(1)
def reel_of(size: ImageSize, most: int) -> Reel:
    """Simulate a reel of this size with at most ``most`` distinct frames; the latest one is cached."""
    from ospc.simulation import SimulationSettings, frames  # not at the top: its textures take memory

    count = min(_DISTINCT, most)
    settings = SimulationSettings(size=size, frames=count, seed=_SEED, response="srgb", moving_objects=4)
    images, exposures_ms = [], []
    for frame in frames(settings):
        images.append(encoded(frame.image, ".jpg", frame.name, jpeg_quality=_QUALITY))
        exposures_ms.append(frame.exposure_ms)
    return Reel(tuple(images), tuple(exposures_ms))
