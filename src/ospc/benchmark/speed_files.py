"""What a measurement of speed is written as: a table, JSON, and a picture of bars."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ospc.atomic import write_atomically
from ospc.benchmark.speed import SpeedRow
from ospc.benchmark.tables import Table
from ospc.report.style import new_figure, rules, save
from ospc.versions import versions

_HEADER = (
    "preset", "size", "frames", "frames/s", "× decoding", "× decoding, CPU", "push 50 %", "99 %", "memory", "notes",
)  # fmt: skip
_COLOURS = ("#0072B2", "#56B4E9", "#009E73", "#F0E442", "#E69F00", "#D55E00", "#CC79A7", "#000000")


def table_of(rows: Sequence[SpeedRow]) -> Table:
    """Return the figures of all rows."""
    return Table("Speed", _HEADER, tuple(_cells(row) for row in rows), 2)


def _cells(row: SpeedRow) -> tuple[str, ...]:
    live = row.preset == "live"
    return (
        row.preset,
        f"{row.size[0]}×{row.size[1]}",
        str(row.frames),
        f"{row.frames_per_second:.3g}",
        "–" if live else f"{row.over_decoding:.2f}",
        f"{row.cpu_s / row.decoding_cpu_s:.2f}",
        f"{row.push_ms[0]:.2g} ms",
        f"{row.push_ms[1]:.2g} ms",
        f"{row.peak_mb:.0f} MB",
        row.notes,
    )


def as_json(rows: Sequence[SpeedRow]) -> dict[str, Any]:
    """Return everything as JSON-compatible values."""
    import os

    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "system": platform.system()}
    return {"rows": [row.as_dict() for row in rows], "machine": machine, "versions": versions()}


def write(folder: Path, rows: Sequence[SpeedRow]) -> tuple[list[Path], list[str]]:
    """Write speed.json and speed.png; return their paths, and what could not be written."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(as_json(rows), indent=1)
    paths = [write_atomically(folder / "speed.json", text.encode())]
    return [*paths, draw(rows, folder / "speed.png")], []


def draw(rows: Sequence[SpeedRow], path: Path) -> Path:
    """Draw where the time goes: a bar a row, divided by stage; what other threads do at the same time is not in it.

    Raises
    ------
    FormatError
        If the picture cannot be written.
    """
    shown = [row for row in rows if row.stages]
    stages = list(dict.fromkeys(stage for row in shown for stage in row.stages))
    figure = new_figure(11.0, 1.5 + 0.5 * len(shown))
    with rules():
        axes = figure.subplots()
        for place, row in enumerate(shown):
            left = 0.0
            for stage in stages:
                share = row.stages.get(stage, 0.0) / row.seconds
                colour = _COLOURS[stages.index(stage) % len(_COLOURS)]
                axes.barh(place, share, left=left, color=colour, height=0.7)
                if share > 0.06:
                    axes.text(left + share / 2, place, stage, ha="center", va="center", fontsize=8, color="white")
                left += share
        names = [f"{r.preset}, {r.size[0]}×{r.size[1]}: {1e3 * r.seconds / r.frames:.3g} ms a frame" for r in shown]
        axes.set(yticks=range(len(shown)), yticklabels=names, xlim=(0, 1), xlabel="share of the time, by stage")
        axes.invert_yaxis()
        axes.grid(visible=False)
        return save(figure, path)
