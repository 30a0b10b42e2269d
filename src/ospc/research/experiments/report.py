"""The tables, curves and pictures of an experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from ospc.formats.files import csv_text
from ospc.research.experiments.design import Experiment
from ospc.research.measurement import Measurement, medians, methods_of, metrics, recordings_of
from ospc.research.pictures import draw_curves, draw_errors
from ospc.research.scoring import curves_of
from ospc.research.source import Source
from ospc.research.tables import Table, measurements_csv, write

_SHOWN = metrics("response_rmse", "response_shape_rmse", "log_ratio_error", "vignette_rmse", "exposure_error")
"""The metrics of the table."""


def write_experiment(
    experiment: Experiment, sources: Sequence[Source], rows: Sequence[Measurement], folder: Path
) -> list[Path]:
    """Write ``measurements.csv``, ``table.md`` and ``errors.png``, and the curves found on each recording.

    Errors are those of :func:`~ospc.research.tables.write`.
    """
    texts = {"measurements.csv": measurements_csv(rows), "table.md": median_table(rows).as_markdown()}
    pictures: dict[str, Callable[[Path], Path]] = {"errors.png": partial(draw_errors, experiment.comparison, rows)}
    for source in sources:
        found = [row for row in rows if row.recording == source.name]
        curves = {"truth": curves_of(source.truth()), **{row.method: row.curves for row in found}}
        texts[f"curves-{source.name}.csv"] = _curves_csv({name: c for name, c in curves.items() if c})
        ratios = found if experiment.with_ratios else []
        if ratios:
            texts[f"ratios-{source.name}.csv"] = _ratios_csv(ratios)
        if not experiment.comparison.varied:
            pictures[f"curves-{source.name}.png"] = partial(draw_curves, source.name, curves, ratios)
    return write(folder, texts, pictures)


def median_table(rows: Sequence[Measurement]) -> Table:
    """Return the medians over recordings, one line a method, the lowest of each column marked.

    A figure that is missing counts as infinite.
    """
    columns = [medians(rows, metric.figure) for metric in _SHOWN]
    recordings = len(recordings_of(rows))
    lines, best = [], set()
    for number, name in enumerate(methods_of(rows)):
        for place, column in enumerate(columns):
            if math.isfinite(column[name]) and column[name] == min(column.values()):
                best.add((number, place + 1))
        failed = sum(bool(row.problem) for row in rows if row.method == name)
        texts = (metric.text(column[name]) for metric, column in zip(_SHOWN, columns, strict=True))
        lines.append((name, *texts, f"{failed}/{recordings}"))
    title = f"Medians over {recordings} recordings" if recordings > 1 else "Errors"
    header = ("method", *(metric.label for metric in _SHOWN), "no result")
    return Table(title, header, tuple(lines), best=frozenset(best))


def _curves_csv(curves: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Return g at 256 grey levels and V at 50 radii, one column a method."""
    rows: list[list[object]] = []
    for letter, part, places in (
        ("g", "response", range(256)),
        ("V", "vignette", [round((ring + 0.5) / 50, 2) for ring in range(50)]),
    ):
        for number, place in enumerate(places):
            values = [float(f"{c[part][number]:.6g}") if part in c else None for c in curves.values()]
            rows.append([letter, place, *values])
    return csv_text([["curve", "at", *curves], *rows])


def _ratios_csv(rows: Sequence[Measurement]) -> str:
    columns = ("frames", "metadata", "estimated", "samples")
    lines = [
        [row.method, *pair, float(f"{k:.6g}"), float(f"{estimate:.6g}"), samples]
        for row in rows
        if row.ratios
        for pair, k, estimate, samples in zip(*(row.ratios[name] for name in columns), strict=True)
    ]
    return csv_text([["method", "first", "second", "metadata", "estimated", "samples"], *lines])
