"""The table, JSON and picture of a measurement of speed."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ospc.report.style import new_figure, rules, save
from ospc.research.pictures import look
from ospc.research.speed.measuring import SpeedRow
from ospc.research.tables import Table, as_json, write
from ospc.versions import versions

_HEADER = (
    "", "size", "frames", "seconds", "CPU s", "against", "×", "×, CPU", "goal", "push 50 %", "99 %", "memory", "notes"
)  # fmt: skip
_LEAST_NAMED = 0.06
"""Share of the time from which a stage's name fits into its bar."""


def table_of(rows: Sequence[SpeedRow]) -> Table:
    """Return the figures of all rows."""
    return Table("Speed", _HEADER, tuple(_cells(row) for row in rows), 2)


def _cells(row: SpeedRow) -> tuple[str, ...]:
    at_a_pace = row.what.startswith("live")
    push = ("", "") if row.push_ms is None else tuple(f"{ms:.2g} ms" for ms in row.push_ms[:2])
    verdict = {True: "reached", False: "missed", None: ""}[row.met]
    return (
        row.what,
        f"{row.size[0]}×{row.size[1]}",
        str(row.frames),
        f"{row.seconds:.3g}",
        f"{row.cpu_s:.3g}",
        f"{row.against}: {row.against_s:.3g} s",
        "" if at_a_pace else f"{row.ratio:.2f}",
        f"{row.cpu_ratio:.2f}",
        f"{row.goal}: {verdict}" if row.goal else "",
        *push,
        "" if row.peak_mb is None else f"{row.peak_mb:.0f} MB",
        row.notes,
    )


def content_of(rows: Sequence[SpeedRow]) -> dict[str, Any]:
    """Return everything as JSON-compatible values."""
    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "system": platform.system()}
    return {"rows": [row.as_dict() for row in rows], "machine": machine, "versions": versions()}


def write_speed(folder: Path, rows: Sequence[SpeedRow]) -> list[Path]:
    """Write speed.json, speed.md and speed.png; errors are those of :func:`~ospc.research.tables.write`."""
    texts = {"speed.json": as_json(content_of(rows)), "speed.md": table_of(rows).as_markdown()}
    return write(folder, texts, {"speed.png": partial(_draw, rows)} if any(row.stages for row in rows) else None)


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
