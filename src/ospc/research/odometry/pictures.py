"""Pictures of odometry: cumulative errors, and trajectories aligned to either end of the truth (paper, figure 6).

A picture that cannot be written is a :class:`~ospc.errors.FormatError`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError
from ospc.evaluation.similarity import align_similarity
from ospc.evaluation.trajectory import Trajectory, associate
from ospc.report.style import BLUE, GREEN, ORANGE, new_figure, printable, rules, save
from ospc.research.odometry.conditions import Condition
from ospc.research.odometry.judging import RunResult
from ospc.research.pictures import figure_of_panels, look

_PANEL_IN = (4.4, 4.4)
"""Width and height of a trajectory in inches."""


def draw_cumulative(results: Sequence[RunResult], conditions: Sequence[Condition], path: Path) -> Path:
    """Draw the number of finished runs below an alignment error, one line a condition."""
    figure = new_figure(7.0, 5.2)
    with rules():
        axes = figure.subplots()
        largest = max([r.error for r in results if math.isfinite(r.error)], default=1.0)
        for number, condition in enumerate(conditions):
            errors = [r.error for r in results if r.condition == condition.name]
            finite = np.sort([e for e in errors if math.isfinite(e)])
            if not errors:
                continue
            steps = np.concatenate([finite, [1.5 * largest]])
            counts = np.concatenate([np.arange(1, finite.size + 1), [finite.size]])
            label = f"{condition.title}: {finite.size} of {len(errors)} finished"
            axes.step(steps, counts, where="post", label=label, **look(number))
        axes.set(
            xscale="log",
            ylim=(0, None),
            xlabel="alignment error $e_{align}$, in units of the truth",
            ylabel="runs with at most that error",
            title="Cumulative error of all runs",
        )
        figure.legend(loc="outside lower center", ncols=2)
        return save(figure, path)


def draw_trajectories(runs: Sequence[tuple[Condition, RunResult]], truth: Trajectory, title: str, path: Path) -> Path:
    """Draw one run for each condition, aligned to the first and to the last part of the truth; NaN is unknown."""
    plane = _widest_axes(truth.positions[truth.known])
    with rules():
        figure, panels = figure_of_panels(len(runs), 3, _PANEL_IN)
        figure.suptitle(printable(title), parse_math=False)
        for axes, (condition, result) in zip(panels, runs, strict=True):
            error = "" if result.errors is None else f", $e_{{align}}$ = {result.errors.e_align:.3g}"
            axes.set_title(f"{condition.title}{error}")
            _draw(axes, result, truth, plane)
        return save(figure, path)


def _draw(axes: Any, result: RunResult, truth: Trajectory, plane: tuple[FloatArray, FloatArray]) -> None:
    across, up = plane
    copies = _aligned_copies(result.tracked.trajectory, truth)
    if not copies:
        axes.text(
            0.5,
            0.5,
            f"{result.ending}\n{printable(result.reason)}",
            ha="center",
            wrap=True,
            parse_math=False,
            transform=axes.transAxes,
        )
    looks = ((BLUE, "aligned to the start"), (ORANGE, "aligned to the end"))
    for copy, (colour, label) in zip(copies, looks, strict=False):
        axes.plot(copy @ across, copy @ up, color=colour, lw=1.1, label=label)
    axes.plot(
        truth.positions @ across, truth.positions @ up, color=GREEN, ls="--", lw=1.6, label="truth, where known"
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="units of the truth")
    axes.legend(loc="best")


def _aligned_copies(trajectory: Trajectory | None, truth: Trajectory) -> list[FloatArray]:
    """Return the positions aligned to either half of the truth; none where that is not possible."""
    if trajectory is None:
        return []
    partner = associate(trajectory.stamps_s, truth.stamps_s)
    target = truth.positions[partner]
    known = (partner >= 0) & np.isfinite(target).all(axis=1) & trajectory.known
    middle = len(truth) // 2
    try:
        return [
            align_similarity(trajectory.positions[half & known], target[half & known])(trajectory.positions)
            for half in (partner < middle, partner >= middle)
        ]
    except (NotObservableError, FormatError):
        return []


def _widest_axes(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the two directions, shape (3,) each, in which points spread most."""
    _, _, directions = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    return directions[0], directions[1]
