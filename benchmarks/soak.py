"""Push a million small frames, calibrate every thousand, and check that memory, time and results stay constant.

    python benchmarks/soak.py --results FILE --kind engine|live [--frames 1000000]

A camera walks forth and back through one simulated scene, with a different order of its exposures on every walk.
Every thousand frames add a line of JSON to FILE: memory, open files, threads, times and the result. The table
compares the frames from 20 000 on with those at the end; --table only prints it.
"""

from __future__ import annotations

import argparse
import json
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from ospc import Calibration, Frame, LiveCalibrator, OnlineCalibrator
from ospc.photometry.vignette import diagonal_profile
from ospc.settings import DefaultSettings
from ospc.simulation import SimulationSettings, frames, truth
from results import Row, table_of

SIZE = (128, 96)
VIEWS = 480
EXPOSURES_MS = (3.0, 5.0, 8.0, 12.0, 20.0)
ASKED_EVERY = 1000
SETTLED_FRAMES, MEDIAN_OF = 20_000, 10
"""Frames after which memory has to stay constant, and number of lines compared at the beginning and at the end."""

WAITING = 64
"""Frames that may wait for the live calibrator's thread, so that its queue is used but none is dropped."""

GREYS, RADII = np.linspace(0.1, 0.9, 9), np.linspace(0, 1, 6)
"""Grey levels and radii at which responses and vignettes are compared."""

SETTINGS = DefaultSettings(points_per_pair=200, max_points=6000, rounds=4)
"""Small settings, so that a calibration every thousand frames takes little time."""


def settings(exposures_ms: tuple[float, ...]) -> SimulationSettings:
    """Return the camera and its walk, fast enough that scene points also reach the corners."""
    return SimulationSettings(size=SIZE, frames=VIEWS, exposure="cycle", exposures_ms=exposures_ms, speed=2.0, seed=3)


def pools() -> list[list[Frame]]:
    """Return the frames of one walk, once for each order of the exposures."""
    made = []
    for n in range(len(EXPOSURES_MS)):
        walk = frames(settings(EXPOSURES_MS[n:] + EXPOSURES_MS[:n]))
        made.append([Frame.of_array(frame.image, frame.exposure_ms) for frame in walk])
        for frame in made[-1]:
            frame.image.setflags(write=False)
    return made


def film(made: list[list[Frame]], number_of_frames: int) -> Iterator[Frame]:
    walk = [*range(VIEWS), *range(VIEWS - 2, 0, -1)]
    for number in range(number_of_frames):
        turn, step = divmod(number, len(walk))
        frame = made[turn % len(made)][walk[step]]
        yield Frame.of_array(frame.image, frame.exposure_ms, index=number, stamp_s=number / 50)


def shape(calibration: Calibration) -> list[float]:
    """Return ln inverse response relative to its middle, and the vignette's profile."""
    if calibration.response is None or calibration.vignette is None:
        return []
    log_inverse = np.log(calibration.response.inverse(GREYS))
    profile = diagonal_profile(calibration.vignette, RADII)
    return [*(log_inverse - log_inverse[len(GREYS) // 2]), *profile]


def status(number: int, calibration: Calibration, push_s: float, process_s: float, asked_s: float) -> dict[str, Any]:
    """Return the values that have to stay constant."""
    return {
        "frames": number,
        "rss_kib": int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024,
        "files": len([*Path("/proc/self/fd").iterdir()]),
        "threads": threading.active_count(),
        "push_us": 1e6 * push_s / ASKED_EVERY,
        "process_us": 1e6 * process_s / ASKED_EVERY,
        "calibration_s": asked_s,
        "shape": shape(calibration),
        "verdicts": {name: verdict.state for name, verdict in calibration.verdicts.items()},
        "warnings": list(calibration.warnings),
    }


def soak(kind: str, number_of_frames: int, results: Path) -> None:
    made = pools()
    live = LiveCalibrator(SETTINGS) if kind == "live" else None
    calibrator = live or OnlineCalibrator(SETTINGS)
    push_s, process_begun_s = 0.0, time.process_time()
    for number, frame in enumerate(film(made, number_of_frames), start=1):
        begun_s = time.perf_counter()
        calibrator.push(frame)
        push_s += time.perf_counter() - begun_s
        if live is not None:
            live.wait(WAITING)
        if number % ASKED_EVERY == 0:
            process_s, begun_s = time.process_time() - process_begun_s, time.process_time()
            found = calibrator.calibration()
            row = status(number, found, push_s, process_s, time.process_time() - begun_s)
            if live is not None:
                row |= {"dropped": live.status.dropped, "epochs": len(live.status.epochs)}
            else:
                assert isinstance(calibrator, OnlineCalibrator)
                row["epochs"] = len(calibrator.epochs)
            with results.open("a") as stream:
                stream.write(json.dumps(row | {"kind": kind}) + "\n")
            push_s, process_begun_s = 0.0, time.process_time()
    if live is not None:
        live.close()


def table(results: Path) -> str:
    """Return the change between the frames from 20 000 on and those at the end, as medians of ten lines."""
    rows = [json.loads(line) for line in results.read_text().splitlines()]
    known = truth(settings(EXPOSURES_MS))
    expected = np.array(shape(Calibration(SIZE, known.response, known.vignette)))
    shown: list[Row] = []
    for kind in sorted({row["kind"] for row in rows}):
        own = [row for row in rows if row["kind"] == kind]
        settled = [row for row in own if row["frames"] > SETTLED_FRAMES] or own
        names = ("rss_kib", "push_us", "process_us", "calibration_s")
        ends = [
            {name: float(np.median([row[name] for row in part])) for name in names}
            for part in (settled[:MEDIAN_OF], settled[-MEDIAN_OF:])
        ]
        shapes = np.array([row["shape"] for row in settled if row["shape"]])
        memory = [end["rss_kib"] for end in ends]
        ranges = {
            name: " to ".join(str(value) for value in sorted({f(row[name] for row in settled) for f in (min, max)}))
            for name in ("files", "threads")
        }
        cells = {
            "calibrator": kind,
            "RSS MiB": f"{memory[1] / 1024:.0f}",
            "growth": f"{100 * (memory[1] / memory[0] - 1):+.1f} %",
            "push µs": " → ".join(f"{end['push_us']:.0f}" for end in ends),
            "processor µs": " → ".join(f"{end['process_us']:.0f}" for end in ends),
            "calibration s": " → ".join(f"{end['calibration_s']:.2f}" for end in ends),
            "drift": float(np.ptp(shapes, axis=0).max()),
            "worst error": float(np.abs(shapes - expected).max()),
        }
        shown.append({**own[-1], **ranges, **cells})
    columns = (
        "calibrator", "frames", "RSS MiB", "growth", "files", "threads", "push µs", "processor µs", "calibration s",
        "drift", "worst error", "epochs", "dropped",
    )  # fmt: skip
    return table_of("A million frames", shown, columns)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--kind", choices=("engine", "live"), default="engine")
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--table", action="store_true", help="only print the table")
    arguments = parser.parse_args()
    if not arguments.table:
        soak(arguments.kind, arguments.frames, arguments.results)
    print(table(arguments.results))


if __name__ == "__main__":
    main()
