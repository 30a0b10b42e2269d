"""What all measuring programs share: calls whose results are kept, and tables of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from ospc.research.runner import OnProgress, ResultStore, made_with, run
from ospc.research.tables import Table

Row: TypeAlias = dict[str, Any]
"""One result: JSON-compatible values by name."""


@dataclass(frozen=True)
class Call:
    """A call that takes long; its name says all that the result depends on beside the source of the package."""

    name: str
    function: Callable[[], Row]

    def describe(self) -> dict[str, Any]:
        return {"call": self.name, "made_with": made_with()}

    def run(self, _progress: OnProgress) -> Row:
        return self.function()


def measured(calls: Mapping[str, Callable[[], Row]], folder: Path) -> list[Row]:
    """Return the results of calls; those that the folder has already are not computed again."""
    found: dict[str, Row] = {}
    for one in run([Call(*call) for call in calls.items()], ResultStore(folder)):
        found[one.task.name] = one.result
        if not one.stored:
            print(one.task.name, "done", flush=True)
    return [found[name] for name in calls]


def table_of(title: str, rows: Iterable[Row], columns: Sequence[str], names: int = 1) -> str:
    """Return rows as a Markdown table with a column for each name; absent values are shown as a dash."""
    cells = tuple(tuple(_text(row.get(column)) for column in columns) for row in rows)
    return Table(title, tuple(columns), cells, names).as_markdown()


def _text(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
