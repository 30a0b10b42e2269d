"""The speed of a preset against decoding the same frames, in the same process, just before."""

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
SLOW_FRAMES = 30
"""Frames that preset "paper" is measured with: it takes the same time for each."""

_DISTINCT = 150
"""Frames that are simulated and then shown again and again: more would take long, and memory."""

_QUALITY = 92
"""JPEG quality of the frames, that of usual cameras."""

_FRAMES_PER_SECOND = 20
_SEED = 7


@dataclass(frozen=True)
class SpeedRow:
    """The speed of one preset at one size.

    Attributes
    ----------
    preset
        Name of the preset; "live" for the default one in the background of a camera.
    size
        Width and height of the frames.
    frames, seconds
        Frames pushed, and the time of all of them and of the final calibration; of a live run, its length.
    decoding_s, decoding_cpu_s
        Time, and processor time, of decoding the same frames in one thread just before.
    cpu_s
        Processor time of all threads together.
    push_ms
        Median, 99th percentile and maximum of the time of one push.
    peak_mb
        Largest resident memory of the process; None where the system does not say.
    stages
        Seconds by stage; the last, "other", is the rest.
    notes
        Remarks.
    """

    preset: str
    size: ImageSize
    frames: int
    seconds: float
    decoding_s: float
    decoding_cpu_s: float
    cpu_s: float
    push_ms: tuple[float, float, float]
    peak_mb: float | None
    stages: dict[str, float] = field(default_factory=dict)
    notes: str = ""

    @property
    def frames_per_second(self) -> float:
        """Frames per second, the final calibration included."""
        return self.frames / self.seconds

    @property
    def over_decoding(self) -> float:
        """Time divided by that of decoding the same frames."""
        return self.seconds / self.decoding_s

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON-compatible values."""
        derived = {"frames_per_second": self.frames_per_second, "over_decoding": self.over_decoding}
        return asdict(self) | derived


@dataclass(frozen=True)
class Reel:
    """Encoded frames of a simulated walk, which can be played forward and backward for any length of time.

    Attributes
    ----------
    images, exposures_ms
        Grey JPEG files, and the exposure of each in milliseconds.
    """

    images: tuple[bytes, ...]
    exposures_ms: tuple[float, ...]

    @classmethod
    def simulated(cls, size: ImageSize, distinct: int = _DISTINCT) -> Reel:
        """Simulate a walk of this many frames."""
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
        """Return the image of a frame: forward, backward, and forward again."""
        period = max(1, 2 * len(self.images) - 2)
        turn = index % period
        return min(turn, period - turn)

    def frames(self, count: int) -> Iterator[Frame]:
        """Give this many frames, decoded when they are used."""
        for index in range(count):
            place = self.place(index)
            name = f"frame {index}"
            load = partial(decode_grey, self.images[place], name)
            yield Frame(
                index, index / _FRAMES_PER_SECOND, self.exposures_ms[place], name, load, verify=_nothing, threads=True
            )

    def decoding_s(self, count: int) -> tuple[float, float]:
        """Return the time, and processor time, of decoding this many frames in one thread."""
        begun, cpu = time.perf_counter(), time.thread_time()
        for index in range(count):
            cv2.imdecode(np.frombuffer(self.images[self.place(index)], np.uint8), cv2.IMREAD_GRAYSCALE)
        return time.perf_counter() - begun, time.thread_time() - cpu


def _nothing() -> None:
    """Nothing to verify: the images are in memory."""


def measured(
    presets: tuple[str, ...], sizes: tuple[ImageSize, ...], count: int, live_s: float, rate_hz: float
) -> Iterator[SpeedRow]:
    """Measure each preset at each size in a process of its own, so that peak memory is its own too.

    Parameters
    ----------
    presets, sizes
        Names of presets, and sizes of the frames.
    count
        Frames; of preset "paper" at most :data:`SLOW_FRAMES`.
    live_s, rate_hz
        Seconds that a camera is simulated live, 0 for none, and its frames per second.
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
    """Measure a preset in this process, with clocks in its steps.

    Raises
    ------
    OspcError
        If the recording cannot be calibrated.
    """
    from ospc.calibrator import OnlineCalibrator
    from ospc.recording.ahead import decoded_ahead
    from ospc.research.speed.stages import clocks, with_rest

    count = min(count, SLOW_FRAMES) if preset == "paper" else count
    decoding = reel.decoding_s(count)
    pushes: list[float] = []
    with clocks() as stages:
        begun, cpu = time.perf_counter(), time.process_time()
        calibrator = OnlineCalibrator(preset)
        for frame in decoded_ahead(reel.frames(count), calibrator.foresees):
            before = time.perf_counter()
            calibrator.push(frame)
            pushes.append(time.perf_counter() - before)
        calibrator.calibration()
        seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    return SpeedRow(
        preset, size, count, seconds, *decoding, cpu, _spread(np.array(pushes)), peak_mb(), with_rest(stages, seconds)
    )


def run_live(size: ImageSize, reel: Reel, seconds: float, rate_hz: float) -> SpeedRow:
    """Push frames to a live calibrator in this process, at the pace of a camera."""
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
    known = "not converged" if known_s is None else f"converged after {known_s:.0f} s"
    notes = f"{rate_hz:g} frames/s; {status.processed} processed, {status.unusable} unusable; {known}"
    whole, cpu = time.perf_counter() - begun, time.process_time() - cpu
    return SpeedRow("live", size, count, whole, *decoding, cpu, _spread(np.array(pushes)), peak_mb(), notes=notes)


def peak_mb() -> float | None:
    """Return the largest resident memory of this process so far in megabytes; None where unknown."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    except OSError:
        pass
    return None


def _spread(seconds: FloatArray) -> tuple[float, float, float]:
    milliseconds = 1e3 * seconds
    median, rare = np.quantile(milliseconds, [0.5, 0.99])
    return float(median), float(rare), float(milliseconds.max())
