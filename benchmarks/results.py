"""Shared by the measuring programs: calls with stored results, tables, and errors of calibrations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeAlias

from ospc import Calibration
from ospc.research.method import Estimate
from ospc.research.runner import ResultStore, Task, made_with, run
from ospc.research.scoring import Truth, score
from ospc.research.source import Source
from ospc.research.tables import Table
from ospc.simulation import SimulationSettings, truth

Row: TypeAlias = dict[str, Any]
"""One result: JSON-compatible values by name."""


def measured(calls: Mapping[str, partial[Row]], folder: Path, jobs: int = 1) -> list[Row]:
    """Return the results of calls, which depend on their name, on the recordings that they get, and on the source.

    Results already stored in the folder are not computed again. Several jobs need calls that can be pickled.
    """
    programs = sha256(b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()
    made = made_with(whole=True) | {"programs": programs}
    recordings = {n: [each.describe() for each in call.args if isinstance(each, Source)] for n, call in calls.items()}
    tasks = [
        Task(name, {"call": name, "recordings": recordings[name], "made_with": made}, partial(_called, call))
        for name, call in calls.items()
    ]
    found: dict[str, Row] = {}
    for task, result in run(tasks, ResultStore(folder), jobs):
        found[task.name] = result
        print(task.name, "done", flush=True)
    return [found[name] for name in calls]


def _called(call: Callable[[], Row], _progress: object) -> Row:
    return call()


def table_of(title: str, rows: Iterable[Row], columns: Sequence[str], names: int = 1) -> str:
    """Return rows as a Markdown table with one column per name; missing values are shown as a dash."""
    cells = tuple(tuple(_text(row.get(column)) for column in columns) for row in rows)
    return Table(title, tuple(columns), cells, names).as_markdown()


def _text(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def figures_of(calibration: Calibration | None, known: Any) -> dict[str, float]:
    """Return the figures of :func:`ospc.research.scoring.score` for a calibration.

    ``known`` has the true response and vignette, or is the settings of a simulation.
    """
    true = truth(known) if isinstance(known, SimulationSettings) else known
    estimate = Estimate() if calibration is None else Estimate.of(calibration)
    return score(estimate, Truth(true.response, true.vignette))


def errors(calibration: Calibration | None, known: Any, prefix: str = "") -> Row:
    """Return vignette RMSE, response shape RMSE and κ; None for a part that the calibration lacks.

    ``known`` is as in :func:`figures_of`.
    """
    figures = figures_of(calibration, known)
    names = {"V": "vignette_rmse", "shape": "response_shape_rmse", "kappa": "log_ratio_error"}
    return {f"{prefix}{name}": figures.get(figure) for name, figure in names.items()}
