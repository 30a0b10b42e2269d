"""Times of calibrating and correcting, relative to decoding or copying the same data in the same run."""

from __future__ import annotations

import compileall
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

import ospc
from ospc.arrays import FloatArray, ImageSize
from ospc.errors import OspcError
from ospc.photometry.calibration import Calibration
from ospc.photometry.correction import Corrector
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import Frame
from ospc.research.speed.reel import Reel

SLOW_FRAMES = 30
"""Frames that preset "paper" is measured with: it needs the same time for each."""
_CORRECTIONS = 40
"""Times that one image is corrected and copied, alternately."""
_SHORTEST_S = 1e-6
"""Shortest time reported: times are divided by it, and a coarse clock may not advance during one copy."""
_POLL_S = 0.02
"""Time between two readings of a command's memory."""
_DONE = (0, 3)
"""Exit codes of commands that did all of their work, whatever the verdict."""


@dataclass(frozen=True)
class SpeedRow:
    """One measurement.

    Attributes
    ----------
    frames, seconds, cpu_s
        Number of frames, total wall-clock time, and processor time of all threads.
    against, against_s, against_cpu_s
        The reference, "decoding" the same frames in one thread or "copying" the same data, and its times.
    push_ms
        Median, 99th percentile and maximum of the time of one push; None if nothing is pushed.
    peak_mb
        Peak resident memory without the input frames; None if the system does not report it.
    """

    what: str
    size: ImageSize
    frames: int
    seconds: float
    cpu_s: float
    against: str
    against_s: float
    against_cpu_s: float
    push_ms: tuple[float, float, float] | None = None
    peak_mb: float | None = None
    notes: str = ""

    @property
    def frames_per_second(self) -> float:
        """Frames per second, everything included."""
        return self.frames / self.seconds

    @property
    def ratio(self) -> float:
        """Time divided by that of decoding or copying."""
        return self.seconds / self.against_s

    @property
    def cpu_ratio(self) -> float:
        """Processor time divided by that of decoding or copying."""
        return self.cpu_s / self.against_cpu_s

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON-compatible values."""
        derived = {name: getattr(self, name) for name in ("frames_per_second", "ratio", "cpu_ratio")}
        return asdict(self) | derived


@dataclass
class _Spent:
    """Wall-clock time and processor time of this process within a context; restarts with each use."""

    seconds: float = 0.0
    cpu_s: float = 0.0

    def __enter__(self) -> _Spent:
        self.seconds, self.cpu_s = -time.perf_counter(), -time.process_time()
        return self

    def __exit__(self, *_error: object) -> None:
        self.seconds = max(self.seconds + time.perf_counter(), _SHORTEST_S)
        self.cpu_s = max(self.cpu_s + time.process_time(), _SHORTEST_S)


def calibrating(size: ImageSize, reel: Reel, preset: str, count: int) -> SpeedRow:
    """Measure pushing frames and the final calibration with a preset in this process."""
    from ospc.calibrator import OnlineCalibrator, drive

    count = min(count, SLOW_FRAMES) if preset == "paper" else count
    decoding = reel.decoding_s(count)
    pushes: list[float] = []

    class Clocked(OnlineCalibrator):
        def push(self, frame: Frame) -> bool:
            before = time.perf_counter()
            used = super().push(frame)
            pushes.append(time.perf_counter() - before)
            return used

    with _Spent() as spent:
        calibrator = Clocked(preset)
        drive(calibrator, reel.frames(count))
        calibrator.calibration()
    times = (spent.seconds, spent.cpu_s, "decoding", *decoding)
    peak_mb = _peak_mb(reel.megabytes)
    return SpeedRow(f"preset {preset}", size, count, *times, push_ms=_spread(pushes), peak_mb=peak_mb)


def live(size: ImageSize, reel: Reel, seconds: float, rate_hz: float) -> SpeedRow:
    """Push frames to a live calibrator in this process, at a camera's frame rate."""
    from ospc.live import LiveCalibrator

    count = max(1, round(seconds * rate_hz))
    decoding = reel.decoding_s(count)
    decoded = [reel.decoded(index) for index in range(min(count, len(reel.images)))]
    shown_mb = reel.megabytes + sum(image.nbytes for image in decoded) / 2**20
    pushes, known_s = [], None
    with _Spent() as spent:
        begun = time.perf_counter()
        with LiveCalibrator() as calibrator:
            for index in range(count):
                time.sleep(max(0.0, begun + index / rate_hz - time.perf_counter()))
                place = reel.place(index)
                frame = Frame.of_array(decoded[place], reel.exposures_ms[place], index=index)
                before = time.perf_counter()
                calibrator.push(frame)
                pushes.append(time.perf_counter() - before)
                if known_s is None and calibrator.status.converged:
                    known_s = time.perf_counter() - begun
            status = calibrator.status
    known = "not converged" if known_s is None else f"converged after {known_s:.0f} s"
    share = f"{spent.cpu_s / spent.seconds:.0%} of a core"
    notes = f"{share}; {status.processed} processed, {status.unusable} unusable; {known}"
    what, times = f"live, {rate_hz:g} frames/s", (spent.seconds, spent.cpu_s, "decoding", *decoding)
    return SpeedRow(what, size, count, *times, push_ms=_spread(pushes), peak_mb=_peak_mb(shown_mb), notes=notes)


def calibrate_command(size: ImageSize, reel: Reel, count: int) -> SpeedRow:
    """Measure all of ``ospc calibrate``, from the start of the program to the report and its plots."""
    with tempfile.TemporaryDirectory() as place:
        recording = reel.write(Path(place, "recording"), count)
        decoding = reel.decoding_s(count)
        seconds, cpu_s, peak_mb = _called("calibrate", str(recording), "-o", str(Path(place, "out")))
    return SpeedRow("ospc calibrate", size, count, seconds, cpu_s, "decoding", *decoding, peak_mb=peak_mb)


def correct_command(size: ImageSize, reel: Reel, count: int) -> SpeedRow:
    """Measure all of ``ospc correct`` to 8 bit, relative to reading its input and writing as many bytes."""
    with tempfile.TemporaryDirectory() as place:
        recording, out = reel.write(Path(place, "recording"), count), Path(place, "out")
        calibration = Path(place, "calibration.json")
        _known_camera(size).save(calibration)
        arguments = (str(recording), str(calibration), "-o", str(out), "--output", "grey8")
        seconds, cpu_s, peak_mb = _called("correct", *arguments)
        before, after = (sorted((folder / "images").iterdir()) for folder in (recording, out))
        with _Spent() as copying:
            for one, other in zip(before, after, strict=True):
                one.read_bytes()
                Path(place, other.name).write_bytes(bytes(other.stat().st_size))
    against = ("copying", copying.seconds, copying.cpu_s)
    return SpeedRow("ospc correct, 8 bit → 8 bit", size, count, seconds, cpu_s, *against, peak_mb=peak_mb)


def correcting(size: ImageSize, reel: Reel, dtype: npt.DTypeLike) -> SpeedRow:
    """Measure correcting an image in memory in one thread, relative to copying the result, alternately."""
    known = _known_camera(size)
    corrector, image = Corrector(known.response, known.vignette), reel.decoded(0)
    corrected = np.asarray(corrector.correct(image, dtype=dtype))
    target = np.empty_like(corrected)
    found = np.empty((_CORRECTIONS, 2, 2))
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for turn in found:
            with _Spent() as spent:
                corrector.correct(image, dtype=dtype)
            with _Spent() as copying:
                np.copyto(target, corrected)
            turn[:] = [(spent.seconds, spent.cpu_s), (copying.seconds, copying.cpu_s)]
    finally:
        cv2.setNumThreads(threads)
    ((seconds, cpu_s), against) = (_CORRECTIONS * np.median(found, axis=0)).tolist()
    what = f"correcting in memory, 8 bit → {np.dtype(dtype).name}"
    return SpeedRow(what, size, _CORRECTIONS, seconds, cpu_s, "copying", against[0], against[1])


def _known_camera(size: ImageSize) -> Calibration:
    return Calibration(size, Response.gamma(2.2), PolynomialVignette(size, (-0.35, 0.05, -0.15)))


def _called(*arguments: str) -> tuple[float, float, float | None]:
    """Run an ``ospc`` command; return its time, processor time and peak memory in MB; OspcError if it fails."""
    _compile()
    begun, before = time.perf_counter(), os.times()
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-m", "ospc", *arguments]
    with subprocess.Popen(command, stdout=quiet, stderr=quiet) as process:  # noqa: S603 - this program
        peak_mb = 0.0
        while process.poll() is None:
            peak_mb = max(peak_mb, _family_mb(process.pid))
            time.sleep(_POLL_S)
    if process.returncode not in _DONE:
        raise OspcError(f"ospc {arguments[0]} failed with exit code {process.returncode}, so its time means nothing")
    seconds, after = time.perf_counter() - begun, os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return seconds, cpu_s, peak_mb or None


def _family_mb(process: int) -> float:
    """Return the memory of a process and its descendants in megabytes; 0 if the system does not report it."""
    private, shared = np.array(_memory_kb(process)).reshape(-1, 2).T
    # The shared memory is mostly the same libraries.
    return float(private.sum() + shared.max(initial=0)) / 1024


def _memory_kb(process: int) -> list[tuple[int, int]]:
    """Return the private and the shared resident memory of a process and of each descendant."""
    place = Path(f"/proc/{process}")
    try:
        lines = [line.split() for line in (place / "smaps_rollup").read_text().splitlines()[1:]]
        children = (place / "task" / str(process) / "children").read_text().split()
    except OSError:
        return []
    private, shared = (
        sum(int(kb) for name, kb, *_ in lines if name.startswith(kind)) for kind in ("Private_", "Shared_")
    )
    return [(private, shared), *(one for child in children for one in _memory_kb(int(child)))]


@cache
def _compile() -> None:
    """Compile all modules, as an installation does; otherwise every start might compile them again."""
    compileall.compile_dir(Path(ospc.__file__).parent, quiet=2)


def _peak_mb(shown_mb: float) -> float | None:
    """Return this process's peak resident memory without the input frames; None if unknown."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024 - shown_mb
    except OSError:
        pass
    return None


def _spread(seconds: list[float]) -> tuple[float, float, float]:
    milliseconds: FloatArray = 1e3 * np.array(seconds)
    median, rare = np.quantile(milliseconds, [0.5, 0.99])
    return float(median), float(rare), float(milliseconds.max())
