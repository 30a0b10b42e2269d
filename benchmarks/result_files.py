"""What all measuring programs share: results that survive an interruption, and tables of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

Row: TypeAlias = dict[str, Any]
"""One result: JSON-compatible values by name."""


class ResultFile:
    """Results in a file of JSON lines, one a line, each with the key of what was measured.

    A program that was interrupted skips the keys that are already there. A line that was cut off counts as absent.

    Parameters
    ----------
    path
        The file; it is made when the first result is added.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows: dict[str, Row] = {}
        if path.is_file():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    row = json.loads(line)
                except json.JSONDecodeError:
                    continue
                self._rows[row["key"]] = row

    def __contains__(self, key: str) -> bool:
        return key in self._rows

    def __getitem__(self, key: str) -> Row:
        return self._rows[key]

    def rows(self, keys: Iterable[str]) -> list[Row]:
        """Return the results of those keys that have one, in the order given."""
        return [self._rows[key] for key in keys if key in self._rows]

    def add(self, key: str, row: Row) -> Row:
        """Append a result and return it with its key."""
        complete = {"key": key, **row}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        # A cut-off last line must not swallow the next one.
        torn = self._path.is_file() and not self._path.read_bytes().endswith(b"\n")
        with self._path.open("a", encoding="utf-8") as file:
            file.write(("\n" if torn else "") + json.dumps(complete) + "\n")
        self._rows[key] = complete
        return complete


def table(rows: Sequence[Row], columns: Sequence[str]) -> str:
    """Return rows as an aligned text table with a column for each name; absent values are shown as a dash."""
    cells = [list(columns), *([_text(row.get(column)) for column in columns] for row in rows)]
    widths = [max(len(line[i]) for line in cells) for i in range(len(columns))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in cells
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def _text(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
