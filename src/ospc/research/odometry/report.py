"""The report of an odometry experiment: the paper's table of median alignment errors, plots and files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError
from ospc.evaluation.trajectory import Trajectory, half_alignments
from ospc.formats.files import csv_text, json_text
from ospc.report.style import BLUE, GREEN, ORANGE, new_figure, printable
from ospc.research.odometry.experiment import Experiment, RunResult, true_trajectory
from ospc.research.odometry.inputs import Condition
from ospc.research.pictures import figure_of_panels, line_style
from ospc.research.tables import StudyReport, Table

_PANEL_IN = (4.4, 4.4)
"""Width and height of one trajectory plot, in inches."""
Columns = dict[str, dict[Condition, list[RunResult]]]
"""The runs of every recording under each condition, ordered by run number."""


def columns_of(experiment: Experiment, results: Iterable[RunResult]) -> Columns:
    """Group the runs by recording and condition."""
    found: Columns = {name: {one: [] for one in experiment.conditions} for name in experiment.recordings}
    for run in sorted(results, key=lambda run: run.run):
        found[run.recording][run.condition].append(run)
    return found


def median_table(columns: Columns) -> Table:
    """Return a table with one row per recording and one column per condition; the lowest median is marked."""
    lines, best = [], set()
    for number, (name, found) in enumerate(columns.items()):
        middles = [_median(runs) for runs in found.values()]
        if math.isfinite(min(middles)):
            best.add((number, 1 + middles.index(min(middles))))
        lines.append((name, *map(_text, middles, found.values())))
    header = ("recording", *(condition.title for condition in next(iter(columns.values()))))
    return Table("Median e_align, in units of the truth", header, tuple(lines), best=frozenset(best))


def _median(runs: Sequence[RunResult]) -> float:
    """Return the median alignment error; infinite if half of the runs or more did not finish."""
    return float(np.median([run.error for run in runs])) if runs else math.inf


def _text(median: float, runs: Sequence[RunResult]) -> str:
    if not runs:
        return "–"
    failed = sum(math.isinf(run.error) for run in runs)
    shown = f"{median:.4f}" if math.isfinite(median) else "failed"
    return f"{shown} ({failed}/{len(runs)} failed)" if failed else shown


def _summary(runs: Sequence[RunResult]) -> dict[str, Any]:
    """Return the median (None if infinite) and how many runs finished."""
    median, finished = _median(runs), sum(math.isfinite(run.error) for run in runs)
    return {"median": median if math.isfinite(median) else None, "finished": finished, "runs": len(runs)}


def odometry_report(experiment: Experiment, results: Iterable[RunResult]) -> StudyReport:
    """Return the report, with ``runs.csv``, ``results.json``, ``table.md`` and plots; its content is the medians."""
    columns = columns_of(experiment, results)
    runs = [run for found in columns.values() for some in found.values() for run in some]
    lines = [run.as_dict() for run in runs]
    medians = {name: {one.name: _summary(some) for one, some in found.items()} for name, found in columns.items()}
    table = median_table(columns)
    texts = {
        "runs.csv": csv_text([lines[0] if lines else [], *(line.values() for line in lines)]),
        "results.json": json_text({"runs": lines, "medians": medians}) + "\n",
        "table.md": table.as_markdown(),
    }
    pictures: dict[str, Callable[[], Any]] = {"cumulative.png": partial(draw_cumulative, runs, experiment.conditions)}
    for name, recording in experiment.recordings.items():
        # For each condition, the run with the median error.
        typical = [sorted(r, key=lambda run: run.error)[(len(r) - 1) // 2] for r in columns[name].values() if r]
        truth = true_trajectory(recording)
        pictures[f"trajectories-{name}.png"] = partial(draw_trajectories, typical, truth, name)
    failures = [
        f"{run.recording}, {run.condition.title}, run {run.run}: {run.ending}; {run.reason}"
        for run in runs
        if run.ending != "finished"
    ]
    return StudyReport([table], texts, pictures, failures, medians)


def draw_cumulative(results: Sequence[RunResult], conditions: Sequence[Condition]) -> Any:
    """Draw the number of finished runs up to an alignment error, one line per condition."""
    figure = new_figure(7.0, 5.2)
    axes = figure.subplots()
    largest = max([r.error for r in results if math.isfinite(r.error)], default=1.0)
    for number, condition in enumerate(conditions):
        errors = [r.error for r in results if r.condition == condition]
        finite = sorted(e for e in errors if math.isfinite(e))
        if not errors:
            continue
        steps, counts = [*finite, 1.5 * largest], [*range(1, len(finite) + 1), len(finite)]
        label = f"{condition.title}: {len(finite)} of {len(errors)} finished"
        axes.step(steps, counts, where="post", label=label, **line_style(number))
    axes.set(xscale="log", ylim=(0, None), title="Cumulative error of all runs")
    axes.set(xlabel="alignment error $e_{align}$, in units of the truth", ylabel="runs with at most that error")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def draw_trajectories(runs: Sequence[RunResult], truth: Trajectory, title: str) -> Any:
    """Draw one run per condition, aligned to the first and to the last part of the truth; NaN is unknown."""
    # The two directions in which the truth extends most.
    points = truth.positions[truth.known]
    across, up, _ = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    figure, panels = figure_of_panels(len(runs), 3, _PANEL_IN)
    figure.suptitle(printable(title), parse_math=False)
    for axes, result in zip(panels, runs, strict=True):
        error = "" if result.errors is None else f", $e_{{align}}$ = {result.errors.e_align:.3g}"
        axes.set_title(f"{result.condition.title}{error}")
        _draw(axes, result, truth, (across, up))
    return figure


def _draw(axes: Any, result: RunResult, truth: Trajectory, plane: tuple[FloatArray, FloatArray]) -> None:
    across, up = plane
    copies: list[FloatArray] = []
    tracked = result.tracked.trajectory
    if tracked is not None:
        with suppress(NotObservableError, FormatError):
            copies = [to(tracked.positions) for to, _ in half_alignments(tracked, truth)]
    if not copies:
        why = f"{result.ending}\n{printable(result.reason)}"
        axes.text(0.5, 0.5, why, ha="center", wrap=True, parse_math=False, transform=axes.transAxes)
    styles = ((BLUE, "aligned to the start"), (ORANGE, "aligned to the end"))
    for copy, (colour, label) in zip(copies, styles, strict=False):
        axes.plot(copy @ across, copy @ up, color=colour, lw=1.1, label=label)
    known = truth.positions @ across, truth.positions @ up
    axes.plot(*known, color=GREEN, ls="--", lw=1.6, label="truth, where known")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="units of the truth")
    axes.legend(loc="best")
