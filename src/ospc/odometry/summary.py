"""The paper's table: medians of the alignment error, one row a recording, the lowest of each row marked."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ospc.odometry.conditions import Condition
from ospc.odometry.run import RunResult


@dataclass(frozen=True)
class Cell:
    """All runs of a recording under a condition.

    Attributes
    ----------
    median
        Median alignment error; infinite where half of the runs or more did not finish.
    finished, runs
        How many finished, of how many.
    """

    median: float
    finished: int
    runs: int

    @property
    def text(self) -> str:
        """As it is printed: the number of runs that failed is said."""
        if not self.runs:
            return "–"
        shown = f"{self.median:.4f}" if math.isfinite(self.median) else "failed"
        missing = self.runs - self.finished
        return shown if not missing else f"{shown} ({missing}/{self.runs} failed)"

    def as_dict(self) -> dict[str, float | int | None]:
        """Return it as JSON-compatible values; None for an infinite median."""
        return {
            "median": self.median if math.isfinite(self.median) else None,
            "finished": self.finished,
            "runs": self.runs,
        }


@dataclass(frozen=True)
class Row:
    """A recording's line of the table."""

    recording: str
    cells: tuple[Cell, ...]

    @property
    def best(self) -> int | None:
        """Index of the lowest median; None where nothing finished."""
        medians = [cell.median for cell in self.cells]
        lowest = min(medians, default=math.inf)
        return medians.index(lowest) if math.isfinite(lowest) else None


def table(results: Sequence[RunResult], conditions: Sequence[Condition]) -> list[Row]:
    """Return one row a recording, in the order in which they first appear, one cell a condition."""
    names = list(dict.fromkeys(result.recording for result in results))
    return [Row(name, tuple(_cell(results, name, c.name) for c in conditions)) for name in names]


def _cell(results: Sequence[RunResult], recording: str, condition: str) -> Cell:
    errors = [r.error for r in results if (r.recording, r.condition) == (recording, condition)]
    if not errors:
        return Cell(math.inf, 0, 0)
    # The median of an even number of runs lies between two; where one of them is infinite, so is it.
    return Cell(float(np.median(errors)), sum(map(math.isfinite, errors)), len(errors))


def markdown(rows: Sequence[Row], conditions: Sequence[Condition]) -> str:
    """Return the table as Markdown, the lowest of each row in bold."""
    lines = [
        "| recording | " + " | ".join(c.title for c in conditions) + " |",
        "|---|" + "---:|" * len(conditions),
    ]
    for row in rows:
        cells = [f"**{cell.text}**" if i == row.best else cell.text for i, cell in enumerate(row.cells)]
        lines.append(f"| {row.recording} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def as_csv(results: Sequence[RunResult]) -> str:
    """Return all runs, one line each, with a heading."""
    text = io.StringIO()
    if results:
        writer = csv.DictWriter(text, list(results[0].as_dict()), lineterminator="\n")
        writer.writeheader()
        writer.writerows(result.as_dict() for result in results)
    return text.getvalue()
