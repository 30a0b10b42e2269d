"""How fast a preset is: against merely decoding the same frames, in the same process, at the same time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FrameError
from ospc.recording import Frame
from ospc.recording.decoding import decode_grey
from ospc.simulation import SimulationSettings, frames

SIZES: tuple[ImageSize, ...] = ((640, 480), (1280, 1024))
PRESETS = ("default", "fast", "paper")
SLOW_FRAMES = 30
"""Frames that preset "paper" is measured with: it takes the same time for each."""

_DISTINCT = 150
_QUALITY = 92
_SEED = 7


@dataclass(frozen=True)
class SpeedRow:
    """How fast one preset is at one size.

    Attributes
    ----------
    preset
        Name of the preset; "live" for the default one in the background of a camera.
    size
        Width and height of the frames.
    frames
        Frames pushed.
    seconds
        Time for all of them and the calibration; of a live run, its length.
    decoding_s, decoding_cpu_s
        Time that merely decoding the same frames took, in one thread, just before; and that of its processor.
    cpu_s
        Processor time of all threads together.
    push_ms
        Median, 99th percentile and maximum of the time of one push.
    peak_mb
        Largest resident memory of the process.
    stages
        Seconds by stage; the last, "other", is all the rest.
    notes
        What else there is to say.
    """

    preset: str
    size: ImageSize
    frames: int
    seconds: float
    decoding_s: float
    decoding_cpu_s: float
    cpu_s: float
    push_ms: tuple[float, float, float]
    peak_mb: float
    stages: dict[str, float] = field(default_factory=dict)
    notes: str = ""

    @property
    def frames_per_second(self) -> float:
        """Frames per second, the final calibration included."""
        return self.frames / self.seconds

    @property
    def over_decoding(self) -> float:
        """Time over that of decoding the same frames."""
        return self.seconds / self.decoding_s

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON-compatible values."""
        derived = {"frames_per_second": self.frames_per_second, "over_decoding": self.over_decoding}
        return {**asdict(self), "size": list(self.size), "push_ms": list(self.push_ms), **derived}


@dataclass(frozen=True)
class Reel:
    """Encoded frames of a simulated walk, to be shown forth and back for as long as one likes.

    Attributes
    ----------
    images
        Grey JPEG files.
    exposures_ms
        Exposure of each in milliseconds.
    """

    images: tuple[bytes, ...]
    exposures_ms: tuple[float, ...]

    @classmethod
    def simulated(cls, size: ImageSize, distinct: int = _DISTINCT) -> Reel:
        """Simulate a walk of so many frames."""
        settings = SimulationSettings(size=size, frames=distinct, seed=_SEED, response="srgb", moving_objects=4)
        images, exposures_ms = [], []
        for frame in frames(settings):
            done, data = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
            if not done:
                raise FrameError(f"{frame.name}: cannot be encoded as JPEG by this OpenCV")
            images.append(data.tobytes())
            exposures_ms.append(frame.exposure_ms)
        return cls(tuple(images), tuple(exposures_ms))

    def place(self, index: int) -> int:
        """Return which image is shown as a frame: forth, back, and forth again."""
        n = len(self.images)
        if n == 1:
            return 0
        turn = index % (2 * n - 2)
        return turn if turn < n else 2 * n - 2 - turn

    def frames(self, count: int) -> Iterator[Frame]:
        """Give so many frames, decoded when they are looked at."""
        for index in range(count):
            place = self.place(index)
            name = f"frame {index}"
            load = partial(decode_grey, self.images[place], name)
            yield Frame(index, index / 20, self.exposures_ms[place], name, load, verify=_nothing, threads=True)

    def decoding_s(self, count: int) -> tuple[float, float]:
        """Return the time that merely decoding so many frames takes in one thread, and that of its processor."""
        begun, cpu = time.perf_counter(), time.thread_time()
        for index in range(count):
            cv2.imdecode(np.frombuffer(self.images[self.place(index)], np.uint8), cv2.IMREAD_GRAYSCALE)
        return time.perf_counter() - begun, time.thread_time() - cpu


def _nothing() -> None:
    """Images in memory are there and whole."""


def measured(
    presets: tuple[str, ...], sizes: tuple[ImageSize, ...], count: int, live_s: float, rate_hz: float
) -> Iterator[SpeedRow]:
    """Measure each preset at each size in a process of its own, whose memory is then its own too.

    Parameters
    ----------
    presets
        Names of presets.
    sizes
        Sizes of the frames.
    count
        Frames; of preset "paper" at most :data:`SLOW_FRAMES`.
    live_s
        Seconds for which a camera is played live; 0 for not at all.
    rate_hz
        Its frames per second.
    """
    for size in sizes:
        reel = Reel.simulated(size, min(_DISTINCT, count))
        jobs: list[Callable[[], SpeedRow]] = [partial(run, name, size, reel, count) for name in presets]
        if live_s > 0:
            jobs.append(partial(run_live, size, reel, live_s, rate_hz))
        for job in jobs:
            with get_context("spawn").Pool(1) as pool:
                yield pool.apply(job)


def run(preset: str, size: ImageSize, reel: Reel, count: int) -> SpeedRow:
    """Measure a preset in this process, whose classes are given clocks.

    Raises
    ------
    OspcError
        If the recording cannot be calibrated.
    """
    from ospc.benchmark.stages import Stages
    from ospc.calibrator import OnlineCalibrator
    from ospc.recording.ahead import decoded_ahead

    count = min(count, SLOW_FRAMES) if preset == "paper" else count
    decoding = reel.decoding_s(count)
    pushes: list[float] = []
    with Stages() as stages:
        begun, cpu = time.perf_counter(), time.process_time()
        calibrator = OnlineCalibrator(preset)
        for frame in decoded_ahead(reel.frames(count), calibrator.foresees):
            before = time.perf_counter()
            calibrator.push(frame)
            pushes.append(time.perf_counter() - before)
        calibrator.calibration()
        seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    return SpeedRow(
        preset, size, count, seconds, *decoding, cpu, _spread(np.array(pushes)), peak_mb(), stages.shares(seconds)
    )


def run_live(size: ImageSize, reel: Reel, seconds: float, rate_hz: float) -> SpeedRow:
    """Play frames at a camera's pace to a live calibrator in this process."""
    from ospc.live import LiveCalibrator

    count = max(1, round(seconds * rate_hz))
    decoding = reel.decoding_s(count)
    decoded = [cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) for data in reel.images]
    pushes, known_s = [], None
    cpu, begun = time.process_time(), time.perf_counter()
    with LiveCalibrator() as live:
        for index in range(count):
            time.sleep(max(0.0, begun + index / rate_hz - time.perf_counter()))
            place = reel.place(index)
            frame = Frame.of_array(decoded[place], reel.exposures_ms[place], index=index)
            before = time.perf_counter()
            live.push(frame)
            pushes.append(time.perf_counter() - before)
            if known_s is None and live.status.converged:
                known_s = time.perf_counter() - begun
        status = live.status
    known = "not known yet" if known_s is None else f"known after {known_s:.0f} s"
    notes = f"{rate_hz:g} frames/s; {status.looked} looked at, {status.unusable} unusable; {known}"
    return SpeedRow(
        "live",
        size,
        count,
        time.perf_counter() - begun,
        *decoding,
        time.process_time() - cpu,
        _spread(np.array(pushes)),
        peak_mb(),
        notes=notes,
    )


def peak_mb() -> float:
    """Return the largest resident memory of this process so far in megabytes; NaN where the system does not tell."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    except OSError:
        pass
    return float("nan")


def _spread(seconds: FloatArray) -> tuple[float, float, float]:
    milliseconds = 1e3 * seconds
    median, rare = np.quantile(milliseconds, [0.5, 0.99])
    return float(median), float(rare), float(milliseconds.max())
