"""The paper's table of median alignment errors, and the files of an odometry experiment."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ospc.formats.files import csv_text
from ospc.research.odometry.experiment import Experiment, Outcome
from ospc.research.odometry.judging import RunResult
from ospc.research.odometry.pictures import draw_cumulative, draw_trajectories
from ospc.research.tables import Table, as_json, write


def median_table(experiment: Experiment, outcome: Outcome) -> Table:
    """Return one row a recording and one column a condition, the lowest median of each row marked."""
    lines, best = [], set()
    for number, name in enumerate(experiment.recordings):
        runs = [outcome.of(name, condition) for condition in experiment.conditions]
        middles = [_median(some) for some in runs]
        if math.isfinite(min(middles)):
            best.add((number, 1 + middles.index(min(middles))))
        lines.append((name, *(_text(middle, some) for middle, some in zip(middles, runs, strict=True))))
    header = ("recording", *(condition.title for condition in experiment.conditions))
    return Table("Median e_align, in units of the truth", header, tuple(lines), best=frozenset(best))


def _median(runs: Sequence[RunResult]) -> float:
    """Return the median alignment error; infinite where half of the runs or more did not finish."""
    return float(np.median([run.error for run in runs])) if runs else math.inf


def _text(median: float, runs: Sequence[RunResult]) -> str:
    if not runs:
        return "–"
    failed = sum(math.isinf(run.error) for run in runs)
    shown = f"{median:.4f}" if math.isfinite(median) else "failed"
    return f"{shown} ({failed}/{len(runs)} failed)" if failed else shown


def medians_of(experiment: Experiment, outcome: Outcome) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the medians by recording and condition, as JSON-compatible values; None for an infinite one."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for name in experiment.recordings:
        for condition in experiment.conditions:
            runs = outcome.of(name, condition)
            median = _median(runs)
            found.setdefault(name, {})[condition.name] = {
                "median": median if math.isfinite(median) else None,
                "finished": sum(math.isfinite(run.error) for run in runs),
                "runs": len(runs),
            }
    return found


def ordered(experiment: Experiment, outcome: Outcome) -> list[RunResult]:
    """Return all runs by recording, condition and number."""
    return [
        run
        for name in experiment.recordings
        for condition in experiment.conditions
        for run in outcome.of(name, condition)
    ]


def write_outcome(experiment: Experiment, outcome: Outcome) -> list[Path]:
    """Write runs.csv, results.json, table.md and the pictures.

    Errors are those of :func:`~ospc.research.tables.write`.
    """
    runs = ordered(experiment, outcome)
    results = [run.as_dict() for run in runs]
    content = {"runs": results, "medians": medians_of(experiment, outcome), "notes": outcome.notes}
    texts = {
        "runs.csv": csv_text([results[0] if results else [], *(result.values() for result in results)]),
        "results.json": as_json(content),
        "table.md": median_table(experiment, outcome).as_markdown(),
    }
    pictures: dict[str, Callable[[Path], Path]] = {
        "cumulative.png": partial(draw_cumulative, runs, experiment.conditions)
    }
    for name, recording in experiment.recordings.items():
        columns = [(condition, outcome.of(name, condition)) for condition in experiment.conditions]
        typical = [(condition, _typical(some)) for condition, some in columns if some]
        truth = experiment.truth_of(recording)
        pictures[f"trajectories-{name}.png"] = partial(draw_trajectories, typical, truth, name)
    return write(experiment.folder, texts, pictures)


def _typical(runs: Sequence[RunResult]) -> RunResult:
    """Return the run whose error is the median."""
    return sorted(runs, key=lambda run: run.error)[(len(runs) - 1) // 2]
