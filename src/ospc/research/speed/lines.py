"""The lines of the speed benchmark, the goals of those that have one, and its table, JSON and picture."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeAlias

from ospc.arrays import ImageSize
from ospc.report.style import new_figure, rules, save
from ospc.research.pictures import look
from ospc.research.runner import OnProgress, Task, made_with
from ospc.research.speed.measuring import (
    SpeedRow,
    calibrate_command,
    calibrating,
    correct_command,
    correcting,
    live,
)
from ospc.research.speed.reel import Reel, reel_of
from ospc.research.tables import StudyReport, Table, as_json
from ospc.versions import versions

VGA, LARGE = (640, 480), (1280, 1024)
SIZES: tuple[ImageSize, ...] = (VGA, LARGE)

_CORRECTED_FRAMES = 60
"""Frames of the folder that is corrected: enough for the start of the program not to decide."""

_LIVE_CORE_SHARE, _LIVE_MB = 0.25, 150.0
"""Share of a core, and memory, that a live calibration of 640×480 at 30 frames/s may take on a small computer."""


_Judged: TypeAlias = Callable[[SpeedRow], SpeedRow]
"""Adds a goal, and whether it is met."""


def _without_goal(row: SpeedRow) -> SpeedRow:
    return row


def _most_s(seconds: float, row: SpeedRow) -> SpeedRow:
    return replace(row, goal=f"≤ {seconds:g} s", met=row.seconds <= seconds)


def _most_ratio(ratio: float, row: SpeedRow) -> SpeedRow:
    return replace(row, goal=f"≤ {ratio:g} × decoding", met=row.ratio <= ratio)


def _live_goal(row: SpeedRow) -> SpeedRow:
    share = row.cpu_s / row.seconds
    met = share <= _LIVE_CORE_SHARE and (row.peak_mb is None or row.peak_mb <= _LIVE_MB)
    return replace(row, goal=f"≤ {_LIVE_CORE_SHARE:.0%} of a core, ≤ {_LIVE_MB:.0f} MB", met=met)


_COMMANDS: dict[ImageSize, dict[int, _Judged]] = {
    VGA: {100: partial(_most_s, 2.0), 500: partial(_most_s, 3.0)},
    LARGE: {600: partial(_most_ratio, 1.0), 1500: partial(_most_ratio, 0.7)},
}
"""Recordings for ``ospc calibrate``, by the size and number of their frames, and their goals."""


def _measure(
    size: ImageSize,
    frames: int,
    measure: Callable[[ImageSize, Reel], SpeedRow],
    judged: _Judged,
    _progress: OnProgress,
) -> dict[str, Any]:
    """Measure in a process of its own, so that its peak memory is its own too."""
    reel = reel_of(size, frames)
    with get_context("spawn").Pool(1) as pool:
        return vars(judged(pool.apply(measure, (size, reel))))


def row_of(stored: dict[str, Any]) -> SpeedRow:
    """Return the row that a task returned."""
    push_ms = None if stored["push_ms"] is None else tuple(stored["push_ms"])
    return SpeedRow(**stored | {"size": tuple(stored["size"]), "push_ms": push_ms})


def speed_tasks(
    presets: tuple[str, ...], sizes: tuple[ImageSize, ...], frames: int, live_s: float, rate_hz: float
) -> list[Task]:
    """Return all measurements, of at most so many frames and ``live_s`` seconds live, about what adds their goals."""
    return [task for size in sizes for task in _tasks_of(size, presets, frames, live_s, rate_hz)]


def _tasks_of(
    size: ImageSize, presets: tuple[str, ...], frames: int, live_s: float, rate_hz: float
) -> Iterator[Task]:
    def task(what: str, measure: Any, judged: _Judged = _without_goal) -> Task:
        name = f"{what}, {size[0]}×{size[1]}"
        machine = {"cores": os.cpu_count(), "node": platform.node()}
        depends_on = {"speed": name, "frames": frames, "machine": machine, "made_with": made_with(whole=True)}
        return Task(name, depends_on, partial(_measure, size, frames, measure, judged), judged)

    for wanted, goal in _COMMANDS.get(size, {frames: _without_goal}).items():
        count = min(wanted, frames)
        measure = partial(calibrate_command, count=count)
        yield task(f"ospc calibrate, {count} frames", measure, goal if count == wanted else _without_goal)
    for name in presets:
        yield task(f"preset {name}", partial(calibrating, preset=name, count=frames))
    if live_s > 0:
        measure = partial(live, seconds=live_s, rate_hz=rate_hz)
        judged = _live_goal if size == VGA and rate_hz == 30 else _without_goal
        yield task(f"live, {live_s:g} s at {rate_hz:g} frames/s", measure, judged)
    count = min(_CORRECTED_FRAMES, frames)
    yield task(f"ospc correct, {count} frames", partial(correct_command, count=count))
    for kind in ("float32", "uint8"):
        yield task(f"correcting in memory to {kind}", partial(correcting, dtype=kind))


_LEAST_NAMED = 0.06
"""Share of the time from which a stage's name fits into its bar."""


def _cells(row: SpeedRow) -> dict[str, str]:
    half, rare = ("", "") if row.push_ms is None else (f"{ms:.2g} ms" for ms in row.push_ms[:2])
    verdict = {True: "reached", False: "missed", None: ""}[row.met]
    return {
        "": row.what,
        "size": f"{row.size[0]}×{row.size[1]}",
        "frames": str(row.frames),
        "seconds": f"{row.seconds:.3g}",
        "CPU s": f"{row.cpu_s:.3g}",
        "against": f"{row.against}: {row.against_s:.3g} s",
        "×": "" if row.what.startswith("live") else f"{row.ratio:.2f}",
        "×, CPU": f"{row.cpu_ratio:.2f}",
        "goal": f"{row.goal}: {verdict}" if row.goal else "",
        "push 50 %": half,
        "99 %": rare,
        "memory": "" if row.peak_mb is None else f"{row.peak_mb:.0f} MB",
        "notes": row.notes,
    }


def speed_report(rows: Sequence[SpeedRow]) -> StudyReport:
    """Return the report, with ``speed.json``, ``speed.md`` and ``speed.png``."""
    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "system": platform.system()}
    content = {"rows": [row.as_dict() for row in rows], "machine": machine, "versions": versions()}
    lines = [_cells(row) for row in rows]
    table = Table("Speed", tuple(lines[0]), tuple(tuple(line.values()) for line in lines), 2)
    texts = {"speed.json": as_json(content), "speed.md": table.as_markdown()}
    pictures = {"speed.png": partial(_draw, rows)} if any(row.stages for row in rows) else {}
    return StudyReport([table], texts, pictures, content=content)


def _draw(rows: Sequence[SpeedRow], path: Path) -> Path:
    """Draw a bar for each row, divided by stage; work of other threads is not in it."""
    shown = [row for row in rows if row.stages]
    stages = list(dict.fromkeys(stage for row in shown for stage in row.stages))
    figure = new_figure(11.0, 1.5 + 0.5 * len(shown))
    with rules():
        axes = figure.subplots()
        for place, row in enumerate(shown):
            left = 0.0
            for number, stage in enumerate(stages):
                share = row.stages.get(stage, 0.0) / row.seconds
                axes.barh(place, share, left=left, color=look(number)["color"], height=0.7)
                if share > _LEAST_NAMED:
                    axes.text(left + share / 2, place, stage, ha="center", va="center", fontsize=8, color="white")
                left += share
        names = [f"{r.what}, {r.size[0]}×{r.size[1]}: {1e3 * r.seconds / r.frames:.3g} ms a frame" for r in shown]
        axes.set(yticks=range(len(shown)), yticklabels=names, xlim=(0, 1), xlabel="share of the time, by stage")
        axes.invert_yaxis()
        axes.grid(visible=False)
        return save(figure, path)
