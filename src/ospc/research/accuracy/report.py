"""The tables and files of the accuracy benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from ospc.research.measurement import (
    Measurement,
    groups_of,
    known_metrics,
    methods_of,
    metrics,
    recordings_of,
    spread,
)
from ospc.research.pictures import draw_errors
from ospc.research.tables import StudyReport, Table, benchmark_report, measurements_csv
from ospc.settings import as_dict, preset

SCHEMA = "ospc-benchmark-accuracy/2"

_TITLES = {
    "simulated": "Simulated recordings, camera in motion",
    "static": "Simulated sweeps of the exposure, camera at rest",
    "video": "Real hand-held video, judged on frames that were not fitted",
    "charts": "Real cameras, response of each colour channel from four exposures of a chart",
}
_MAIN = metrics("response_shape_rmse", "log_ratio_error", "vignette_rmse", "ratio_median_abs")
"""The metrics of the plot and of the table by factor."""

_NOTE = (
    "g(0) = 0, g(255) = 1, V = 1 at the centre; nothing is aligned by an exponent, and only the shape by a scale. "
    "Typical is the median; for shares within ±σ, the mean over all points. A dash: the method gives no result."
)


def accuracy_report(rows: Sequence[Measurement], presets: Sequence[str], notes: Sequence[str]) -> StudyReport:
    """Return the report, with ``results.json``, ``results.csv``, ``table.md`` and ``errors.png``."""
    report = benchmark_report(
        "accuracy",
        _NOTE,
        notes,
        accuracy_tables(rows),
        measurements_csv(rows),
        schema=SCHEMA,
        presets={name: as_dict(preset(name)) for name in presets},
        summary={group: _spreads(members) for group, members in groups_of(rows).items()},
        measurements=[{k: v for k, v in vars(row).items() if k not in ("curves", "ratios")} for row in rows],
    )
    return replace(report, pictures={"errors.png": partial(draw_errors, "Errors of all recordings", _MAIN, rows)})


def accuracy_tables(rows: Sequence[Measurement]) -> list[Table]:
    """Return for each group a summary, medians by factor, and every measurement."""
    tables: list[Table] = []
    for group, members in groups_of(rows).items():
        title = _TITLES.get(group, group)
        tables.append(_summary(title, members))
        if len(recordings_of(members)) > 1:
            tables.append(_by_factor(f"{title}: medians by factor", members))
        tables.append(_every(f"{title}: every recording", members))
    return [table for table in tables if table.rows]


def _spreads(rows: Sequence[Measurement]) -> dict[str, dict[str, Any]]:
    return {
        method: {m.figure: vars(found) for m in known_metrics(rows) if (found := spread(rows, method, m)) is not None}
        for method in methods_of(rows)
    }


def _summary(title: str, members: Sequence[Measurement]) -> Table:
    """Return one line per metric, with the typical and worst value of each method."""
    several = len(recordings_of(members)) > 1
    columns = ("{}: typical", "worst") if several else ("{}",)
    header = ("metric", *(column.format(method) for method in methods_of(members) for column in columns))
    lines = []
    for metric in known_metrics(members):
        line = [metric.label]
        for method in methods_of(members):
            found = spread(members, method, metric)
            if found is None:
                line += ["–"] * len(columns)
                continue
            of_cases = f" ({found.known} of {found.cases})" if found.known < found.cases else ""
            line += [metric.text(found.typical) + of_cases, metric.text(found.worst)][: len(columns)]
        lines.append(tuple(line))
    return Table(title, header, tuple(lines))


def _by_factor(title: str, members: Sequence[Measurement]) -> Table:
    shown = [metric for metric in known_metrics(members) if metric in _MAIN]
    levels = list(dict.fromkeys(level for row in members for level in row.factors.items()))
    levels.sort(key=lambda level: list(members[0].factors).index(level[0]))
    lines = []
    for factor, level in levels:
        alike: dict[tuple[str, ...], list[str]] = {}  # methods by their figures
        for method in methods_of(members):
            there = [row for row in members if row.factors.get(factor) == level]
            found = [spread(there, method, metric) for metric in shown]
            texts = tuple(
                metric.text(None if one is None else one.typical) for metric, one in zip(shown, found, strict=True)
            )
            alike.setdefault(texts, []).append(method)
        lines += [(f"{factor} = {level}", ", ".join(names), *figures) for figures, names in alike.items()]
    return Table(title, ("level", "method", *(m.short for m in shown)), tuple(lines), names=2)


def _every(title: str, members: Sequence[Measurement]) -> Table:
    shown = known_metrics(members)
    limits = list(dict.fromkeys(name for row in members for name in row.limits))
    order = recordings_of(members)
    lines = [
        (
            row.recording,
            row.method + (" (failed)" if row.failure else ""),
            *(m.text(row.figures.get(m.figure)) for m in shown),
            *(f"{row.limits[name]:.4f}" if name in row.limits else "–" for name in limits),
        )
        for row in sorted(members, key=lambda row: order.index(row.recording))
    ]
    header = ("recording", "method", *(m.short for m in shown), *(name.replace("_", " ") for name in limits))
    return Table(title, header, tuple(lines), names=2)
