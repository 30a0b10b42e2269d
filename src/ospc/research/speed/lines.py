"""The measurements of the speed benchmark, their goals, and its table."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import get_context
from typing import Any, TypeAlias

from ospc.arrays import ImageSize
from ospc.formats.files import csv_text
from ospc.research.runner import OnProgress, Task, made_with
from ospc.research.speed.measuring import SpeedRow, calibrate_command, calibrating, correct_command, correcting, live
from ospc.research.speed.reel import Reel, reel_of
from ospc.research.tables import StudyReport, Table, benchmark_report

SCHEMA = "ospc-benchmark-speed/1"

_NOTE = (
    "× is the time relative to decoding the same frames in one thread, or to copying the same data, in the same run. "
    "CPU s is the processor time of all threads. Memory is the peak without the input frames."
)

VGA, LARGE = (640, 480), (1280, 1024)
SIZES: tuple[ImageSize, ...] = (VGA, LARGE)

_CORRECTED_FRAMES = 60
"""Frames that ``ospc correct`` gets: enough that starting the program does not dominate."""
_LIVE_CORE_SHARE, _LIVE_MB = 0.25, 150.0
"""Share of a core and memory that live calibration of 640×480 at 30 frames/s may use on a small computer."""
_Measure: TypeAlias = Callable[[ImageSize, Reel], SpeedRow]

_CALIBRATED: dict[ImageSize, tuple[int, ...]] = {VGA: (100, 500), LARGE: (600, 1500)}
"""Lengths of the recordings for ``ospc calibrate`` by frame size."""


def goal_of(row: SpeedRow) -> tuple[str, bool | None]:
    """Return the goal of a measurement and whether it is reached; empty and None if it has none."""
    small = row.peak_mb is None or row.peak_mb <= _LIVE_MB
    live_goal = f"≤ {_LIVE_CORE_SHARE:.0%} of a core, ≤ {_LIVE_MB:.0f} MB"
    goals = {
        ("ospc calibrate, 100 frames", VGA): ("≤ 2 s", row.seconds <= 2),
        ("ospc calibrate, 500 frames", VGA): ("≤ 3 s", row.seconds <= 3),
        ("ospc calibrate, 600 frames", LARGE): ("≤ 1 × decoding", row.ratio <= 1),
        ("ospc calibrate, 1500 frames", LARGE): ("≤ 0.7 × decoding", row.ratio <= 0.7),
        ("live, 30 frames/s", VGA): (live_goal, row.cpu_s / row.seconds <= _LIVE_CORE_SHARE and small),
    }
    what = f"{row.what}, {row.frames} frames" if row.what == "ospc calibrate" else row.what
    return goals.get((what, row.size), ("", None))


def _measure(size: ImageSize, frames: int, measure: _Measure, _progress: OnProgress) -> dict[str, Any]:
    """Measure in a separate process, so that the peak memory is that of the measurement only."""
    reel = reel_of(size, frames)
    with get_context("spawn").Pool(1) as pool:
        return vars(pool.apply(measure, (size, reel)))


def row_of(stored: dict[str, Any]) -> SpeedRow:
    """Return the row that a task stored."""
    push_ms = None if stored["push_ms"] is None else tuple(stored["push_ms"])
    return SpeedRow(**stored | {"size": tuple(stored["size"]), "push_ms": push_ms})


def speed_tasks(
    presets: tuple[str, ...], sizes: tuple[ImageSize, ...], frames: int, live_s: float, rate_hz: float
) -> list[Task]:
    """Return all measurements, with at most ``frames`` frames each and ``live_s`` seconds of live calibration."""
    machine = {"cores": os.cpu_count(), "node": platform.node()}
    depends_on = {"frames": frames, "machine": machine, "made_with": made_with(whole=True)}
    tasks = []
    for size in sizes:
        counts = dict.fromkeys(min(count, frames) for count in _CALIBRATED.get(size, (frames,)))
        measures: dict[str, _Measure] = {
            f"ospc calibrate, {count} frames": partial(calibrate_command, count=count) for count in counts
        }
        measures |= {f"preset {name}": partial(calibrating, preset=name, count=frames) for name in presets}
        if live_s > 0:
            measures[f"live, {live_s:g} s at {rate_hz:g} frames/s"] = partial(live, seconds=live_s, rate_hz=rate_hz)
        corrected = min(_CORRECTED_FRAMES, frames)
        measures[f"ospc correct, {corrected} frames"] = partial(correct_command, count=corrected)
        measures |= {f"correcting in memory to {t}": partial(correcting, dtype=t) for t in ("float32", "uint8")}
        for what, measure in measures.items():
            name = f"{what}, {size[0]}×{size[1]}"
            tasks.append(Task(name, depends_on | {"speed": name}, partial(_measure, size, frames, measure)))
    return tasks


def _cells(row: SpeedRow) -> dict[str, str]:
    half, rare = ("", "") if row.push_ms is None else (f"{ms:.2g} ms" for ms in row.push_ms[:2])
    goal, met = goal_of(row)
    return {
        "measured": row.what,
        "size": f"{row.size[0]}×{row.size[1]}",
        "frames": str(row.frames),
        "seconds": f"{row.seconds:.3g}",
        "CPU s": f"{row.cpu_s:.3g}",
        "against": f"{row.against}: {row.against_s:.3g} s",
        "×": "" if row.what.startswith("live") else f"{row.ratio:.2f}",
        "×, CPU": f"{row.cpu_ratio:.2f}",
        "goal": f"{goal}: {'reached' if met else 'missed'}" if goal else "",
        "push 50 %": half,
        "99 %": rare,
        "memory": "" if row.peak_mb is None else f"{row.peak_mb:.0f} MB",
        "notes": row.notes,
    }


def speed_report(rows: Sequence[SpeedRow]) -> StudyReport:
    """Return the report, with ``results.json``, ``results.csv`` and ``table.md``."""
    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "system": platform.system()}
    judged = [row.as_dict() | dict(zip(("goal", "met"), goal_of(row), strict=True)) for row in rows]
    lines = [_cells(row) for row in rows]
    table = Table("Speed", tuple(lines[0]), tuple(tuple(line.values()) for line in lines), 2)
    csv = csv_text([table.header, *table.rows])
    return benchmark_report("speed", _NOTE, [], [table], csv, schema=SCHEMA, rows=judged, machine=machine)
