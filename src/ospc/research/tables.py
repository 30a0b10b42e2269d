"""Text tables, CSV, and the files of a study."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ospc.errors import escaped
from ospc.formats.files import csv_text, json_text, write_text
from ospc.report.style import rules, save
from ospc.research.measurement import METRICS, Measurement
from ospc.research.runner import source_hash
from ospc.system.folders import writing
from ospc.system.versions import versions


@dataclass(frozen=True)
class Table:
    """A text table. The first ``names`` columns hold names, the others figures.

    ``best`` contains the row and column of each cell to mark.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    names: int = 1
    best: frozenset[tuple[int, int]] = frozenset()

    def as_markdown(self) -> str:
        """Return the table as Markdown, with figures right-aligned and marked cells in bold."""
        marks = tuple("---" if i < self.names else "---:" for i in range(len(self.header)))
        rows = [
            tuple(f"**{cell}**" if (i, j) in self.best else cell for j, cell in enumerate(row))
            for i, row in enumerate(self.rows)
        ]
        lines = ["| " + " | ".join(map(_as_cell, row)) + " |" for row in (self.header, marks, *rows)]
        return f"## {self.title}\n\n" + "\n".join(lines) + "\n"


def _as_cell(text: str) -> str:
    """Return a text on one line, escaped so that Markdown sees no end of a cell and no HTML."""
    return escaped(text).replace("|", "\\|").replace("<", "&lt;")


def rounded(value: float) -> float:
    """Round a value to six significant digits."""
    return float(f"{value:.6g}")


def measurements_csv(rows: Sequence[Measurement]) -> str:
    """Return CSV with one line per measurement, at full precision."""
    factors = list(dict.fromkeys(name for row in rows for name in row.factors))
    limits = list(dict.fromkeys(name for row in rows for name in row.limits))
    figures = [metric.figure for metric in METRICS]
    parts = ("response", "vignette")
    header = ["recording", "group", *factors, "method", *figures, *limits]
    header += [f"{part}_{what}" for what in ("verdict", "reason") for part in parts]
    lines = []
    for row in rows:
        names = [row.recording, row.group, *map(row.factors.get, factors), row.method]
        values = [*map(row.figures.get, figures), *map(row.limits.get, limits)]
        said = [*map(row.states.get, parts), *map(row.reasons.get, parts), row.failure]
        lines.append([*names, *values, *said])
    return csv_text([[*header, "failure"], *lines])


@dataclass(frozen=True)
class StudyReport:
    """The results of a study: tables to print, and files to write, by name.

    Pictures are functions that return a figure. Notes are remarks, such as the reason for a missing result.
    ``content`` holds everything as JSON-compatible values; None if it is not needed.
    """

    tables: Sequence[Table]
    texts: Mapping[str, str]
    pictures: Mapping[str, Callable[[], Any]] = field(default_factory=dict)
    notes: Sequence[str] = ()
    content: Any = None

    def write(self, folder: Path) -> list[Path]:
        """Create the folder, write all files into it, and return them; SettingError or FormatError if that fails."""
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        files = [write_text(folder / name, text) for name, text in self.texts.items()]
        with rules():
            return files + [save(draw(), folder / name) for name, draw in self.pictures.items()]


def benchmark_report(
    name: str, note: str, notes: Sequence[str], tables: Sequence[Table], csv: str, *, schema: str, **content: Any
) -> StudyReport:
    """Return the report of a benchmark, with ``results.json``, ``results.csv`` and ``table.md``.

    The JSON has the ``content`` with versions and source hash. The document begins with the ``note`` on its figures,
    the ``notes`` on this run, versions and the command.
    """
    made_by = {"schema": schema, "versions": versions(), "source_sha256": source_hash()}
    everything = made_by | {"notes": list(notes)} | content
    made = ", ".join(f"{software} {version}" for software, version in versions().items())
    lines = (*notes, f"Made with {made}; source {source_hash()[:12]}; ospc bench {name}.")
    head = [f"# {name.capitalize()}\n", f"{note}\n", *(f"- {line}\n" for line in lines)]
    document = "\n".join([*head, *(table.as_markdown() for table in tables)])
    texts = {"results.json": json_text(everything) + "\n", "results.csv": csv, "table.md": document}
    return StudyReport(tables, texts, notes=notes, content=everything)
