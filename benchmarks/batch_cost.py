"""Measure the cost of a batch: processor time and bytes per recording, and throughput by number of workers.

    python benchmarks/batch_cost.py cost --recordings 10 100 1000
    python benchmarks/batch_cost.py workers --recordings 40 --workers 1 2

Recordings are simulated: a few are rendered, and the others reuse their images with different exposures. Processor
time is that of this process and its children, so that other work on the machine hardly matters. Throughput is
measured in wall-clock time and is meaningful only on an otherwise idle machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Generator, Iterable
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from ospc.batch.cameras import merged_cameras
from ospc.batch.manifest import Entry
from ospc.batch.run import run_batch
from ospc.batch.store import Store
from ospc.batch.work import Answer, Task, on_this_machine, work
from ospc.calibrator import OnlineCalibrator
from ospc.recording import open_recording
from ospc.recording.recording import identity
from ospc.simulation import SimulationSettings, simulate

RENDERED = 4
PER_CAMERA = 10


def made(folder: Path, count: int, size: tuple[int, int], frames: int) -> list[Entry]:
    exposures = (3.0, 6.0, 12.0, 24.0)
    originals = [folder / f"original{seed}" for seed in range(min(RENDERED, count))]
    for seed, place in enumerate(originals):
        if not place.exists():
            settings = SimulationSettings(
                size=size, frames=frames, seed=seed, exposure="cycle", exposures_ms=exposures, speed=2.0
            )
            simulate(place, settings)
    entries = []
    for n in range(count):
        place = folder / f"r{n:06}"
        if not place.exists():
            relinked(originals[n % len(originals)], place, 1 + n / 1000)
        entries.append(Entry(str(place), f"c{n // PER_CAMERA}"))
    return entries


def relinked(original: Path, place: Path, factor: float) -> None:
    """Create a recording with the images of another one, and its exposures times a factor."""
    shutil.copytree(original, place, copy_function=os.link)
    listed = [line.split() for line in (original / "times.txt").read_text().splitlines() if line[:1] != "#"]
    exposures_ms = [factor * float(exposure) for *_, exposure in listed]
    # The file is linked to the original's, which must not change.
    (place / "times.txt").unlink()
    lines = (f"{name} {stamp} {e}\n" for (name, stamp, _), e in zip(listed, exposures_ms, strict=True))
    (place / "times.txt").write_text("".join(lines))


def processor_s() -> float:
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in usage)


def parts(entries: list[Entry]) -> dict[str, float]:
    """Return the time of each step of a recording, in seconds."""
    times = []
    for entry in entries:
        marks = [time.process_time()]
        recording = open_recording(entry.recording)
        identity(recording)
        marks.append(time.process_time())
        calibrator = OnlineCalibrator()
        for frame in recording:
            calibrator.push(frame)
        for step in (calibrator.calibration, calibrator.summary):
            marks.append(time.process_time())
            step()
        times.append(np.diff([*marks, time.process_time()]))
    names = ("open and identify", "read and compare frames", "estimate", "summary")
    return dict(zip(names, np.mean(times, axis=0).tolist(), strict=True))


def in_this_process(tasks: Iterable[Task]) -> Generator[Answer, None, None]:
    """Run tasks one after the other in this process, whose processor time is measured."""
    yield from map(work, tasks)


def cost(folder: Path, count: int, size: tuple[int, int], frames: int) -> dict[str, object]:
    entries = made(folder, count, size, frames)
    out = folder / f"out{count}"
    begun_s, begun = processor_s(), time.monotonic()
    outcome = run_batch(entries, out, in_this_process)
    whole_s, clock_s = processor_s() - begun_s, time.monotonic() - begun
    begun_s = processor_s()
    merged_cameras(list(outcome.rows), Store(out / "recordings"), out, lambda _done, _all: None)
    merging_s = processor_s() - begun_s
    begun_s = processor_s()
    run_batch(entries, out, in_this_process)
    again_s = processor_s() - begun_s
    results = [place.stat().st_size for place in (out / "recordings").rglob("*.ospc")]
    read = [sum(f.stat().st_size for f in Path(e.recording).rglob("*") if f.is_file()) for e in entries[:RENDERED]]
    return {
        "recordings": count,
        "size": size,
        "frames": frames,
        "failed": len(outcome.failed),
        "processor seconds per recording": whole_s / count,
        "of these for merging": merging_s / count,
        "again, nothing to do": again_s / count,
        "clock seconds": clock_s,
        "bytes of a recording": sum(read) / len(read),
        "bytes of a result": sum(results) / len(results),
        "table and page, bytes": sum((out / n).stat().st_size for n in ("batch.csv", "index.html")),
        "peak memory, MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "parts": parts(entries[:RENDERED]),
    }


def workers(folder: Path, count: int, numbers: list[int], size: tuple[int, int], frames: int) -> dict[str, object]:
    entries = made(folder, count, size, frames)
    seconds = {}
    for number in numbers:
        begun = time.monotonic()
        run_batch(entries, folder / f"workers{number}", partial(on_this_machine, processes=number))
        seconds[number] = time.monotonic() - begun
    ratio = {number: seconds[numbers[0]] / value for number, value in seconds.items()}
    return {"recordings": count, "seconds": seconds, "throughput": ratio, "load": os.getloadavg()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["cost", "workers"])
    parser.add_argument("--recordings", type=int, nargs="+", default=[10, 100])
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--size", type=int, nargs=2, default=[160, 120])
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--folder", type=Path, help="Working folder; a temporary one by default.")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        size = (arguments.size[0], arguments.size[1])
        for count in arguments.recordings:
            if arguments.what == "cost":
                found = cost(folder, count, size, arguments.frames)
            else:
                found = workers(folder, count, arguments.workers, size, arguments.frames)
            print(json.dumps(found, indent=1), flush=True)


if __name__ == "__main__":
    main()
