"""One table and one picture of all systems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ospc.report.style import BLUE, GREY, ORANGE, new_figure, rules, save
from ospc.research.experiments.systems import System
from ospc.research.measurement import METRICS, Measurement, groups_of, metrics, recordings_of, typical
from ospc.research.tables import StudyReport, Table, measurements_csv

_PANELS = metrics("response_shape_rmse", "vignette_rmse")
_MARKERS = {"simulated": "o", "given": "o", "video": "*", "charts": "^"}
"""Markers of the groups of recordings in the picture."""

_COVERAGE = tuple(metric for metric in METRICS if metric.kind == "share")


def systems_report(systems: Sequence[System], rows: Sequence[Measurement], frames: Mapping[str, int]) -> StudyReport:
    """Return the report, with ``measurements.csv``, ``table.md`` and ``systems.png``.

    ``frames`` is the number of frames of every recording.
    """
    tables = system_tables(systems, rows, frames)
    texts = {
        "measurements.csv": measurements_csv(rows),
        "table.md": "\n".join(table.as_markdown() for table in tables),
    }
    return StudyReport(tables, texts, {"systems.png": partial(_draw, systems, rows)})


def system_tables(systems: Sequence[System], rows: Sequence[Measurement], frames: Mapping[str, int]) -> list[Table]:
    """Return the table of every group of recordings, one line a system, and that of the bands' coverage."""
    tables = [_table(group, systems, members, frames) for group, members in groups_of(rows).items()]
    covered = [row for row in rows if any(metric.figure in row.figures for metric in _COVERAGE)]
    return [*tables, _coverage_table(covered)] if covered else tables


def _table(group: str, systems: Sequence[System], rows: Sequence[Measurement], frames: Mapping[str, int]) -> Table:
    lines = []
    for system in systems:
        variants = (system.with_point, system.without_point)
        own = [[row for row in rows if name and row.method == name] for name in variants]
        mine = [row for row in rows if row.method in (*variants, system.name)]
        if not mine:
            continue
        # Failures are counted in a column of their own.
        cells = [metric.text(typical(part, metric)) for metric in _PANELS for part in own]
        times = [1000 * row.seconds / frames[row.recording] for row in mine if row.seconds is not None]
        time = f"{np.median(times):.2f}" if times else "–"
        # Not by figures: a vignette may be found where the true one is unknown.
        solved = {row.recording for row in mine if row.curves}
        count = len(recordings_of(mine))
        about = (system.name, f"{system.authors} {system.year}", system.needs, system.recovers)
        lines.append((*about, *cells, time, f"{count - len(solved)}/{count}"))
    title = f"Medians over {len(recordings_of(rows))} recordings, {group}"
    header = (
        "system", "publication", "needs", "recovers", "response, with its known point", "without",
        "vignette, with", "without", "ms per frame", "no result",
    )  # fmt: skip
    return Table(title, header, tuple(lines), names=4)


def _coverage_table(rows: Sequence[Measurement]) -> Table:
    """Return how often the truth is within the bands of the methods that state some."""
    lines = []
    for group, name in dict.fromkeys((row.group, row.method) for row in rows):
        mine = [row for row in rows if (row.group, row.method) == (group, name)]
        lines.append((name, group, *(metric.text(typical(mine, metric)) for metric in _COVERAGE)))
    header = ("method", "recordings", *(metric.label for metric in _COVERAGE))
    return Table("Coverage of the bands", header, tuple(lines), names=2)


def _draw(systems: Sequence[System], rows: Sequence[Measurement], path: Path) -> Path:
    """Draw the errors of every system with its known point and without, and their medians by group."""
    figure = new_figure(13.0, 1.6 + 0.36 * len(systems))
    with rules():
        panels = figure.subplots(1, len(_PANELS), sharey=True)
        for axes, metric in zip(panels, _PANELS, strict=True):
            for place, system in enumerate(systems):
                for name, colour, shift in ((system.with_point, BLUE, -0.17), (system.without_point, ORANGE, 0.17)):
                    own = [row for row in rows if row.method == name and metric.figure in row.figures]
                    _draw_errors(axes, own, metric.figure, place + shift, colour)
            axes.set(xscale="log", xlabel=metric.label, ylim=(len(systems) - 0.5, -0.5))
            axes.set_yticks(range(len(systems)), [f"{system.name} ({system.year})" for system in systems])
        for label, colour in (("with its known point", BLUE), ("without, or needs none", ORANGE)):
            panels[0].plot([], [], "o", color=colour, label=label)
        for group in dict.fromkeys(row.group for row in rows):
            panels[0].plot([], [], _MARKERS.get(group, "s"), color=GREY, label=f"median, {group}")
        figure.legend(loc="outside lower center", ncols=5)
        return save(figure, path)


def _draw_errors(axes: Any, rows: Sequence[Measurement], figure: str, place: float, colour: str) -> None:
    for group in dict.fromkeys(row.group for row in rows):
        values = [row.figures[figure] for row in rows if row.group == group]
        axes.plot(values, np.full(len(values), place), ".", color=colour, ms=3, alpha=0.35)
        axes.plot(np.median(values), place, _MARKERS.get(group, "s"), color=colour, ms=7)
