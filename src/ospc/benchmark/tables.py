"""Results as tables of text."""

from __future__ import annotations

import csv
import io
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from ospc.benchmark.case import FIGURES, Group
from ospc.benchmark.summary import METRICS, CaseResult, Metric, Spread, contest, groups_of, methods_of, spread

_TITLES: dict[Group, str] = {
    "simulated": "Simulated recordings, camera in motion",
    "static": "Simulated sweeps of the exposure, camera at rest",
    "video": "Real hand-held video, judged on frames that were not fitted",
    "charts": "Real cameras, response of each colour channel from four exposures of a chart",
}
_Outcome = TypeVar("_Outcome", bound=Hashable)
_BY_FACTOR = ("response_shape_rmse", "log_ratio_error", "vignette_rmse", "ratio_median_abs")
_NOTE = (
    "g(0) = 0, g(255) = 1, V = 1 at the centre; nothing is aligned by an exponent, and only the shape by a scale. "
    "Typical is the median, for shares within ±σ the mean over all points. A dash: the method states nothing."
)


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes
    ----------
    title
        Its heading.
    header
        One word a column.
    rows
        The first columns are names, the others figures.
    names
        Number of columns of names.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    names: int = 1

    def as_markdown(self) -> str:
        """Return it as Markdown, figures to the right."""
        rules = tuple("---" if i < self.names else "---:" for i in range(len(self.header)))
        lines = ["| " + " | ".join(row) + " |" for row in (self.header, rules, *self.rows)]
        return f"## {self.title}\n\n" + "\n".join(lines) + "\n"


def all_tables(results: Sequence[CaseResult]) -> list[Table]:
    """Return, for every group: a summary, who is nearer, medians by factor, and a row for every case and method."""
    tables: list[Table] = []
    for group in groups_of(results):
        members = [r for r in results if r.case.group == group and r.rows]
        if not members:
            continue
        tables.append(_summary(_TITLES[group], members))
        if len(members) > 1:
            tables += [_contests(f"{_TITLES[group]}: how often the first came nearer", members)]
            tables += [_by_factor(f"{_TITLES[group]}: medians by factor", members)]
        tables.append(_rows(f"{_TITLES[group]}: every recording", members))
    return [table for table in tables if table.rows]


def as_markdown(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """Return all tables with what has to be known to read them."""
    parts = ["# Accuracy\n", _NOTE + "\n", *(f"- {note}\n" for note in notes)]
    return "\n".join([*parts, *(table.as_markdown() for table in tables)])


def as_csv(results: Sequence[CaseResult]) -> str:
    """Return one line for every case and method, with all digits."""
    factors = list(dict.fromkeys(name for result in results for name in result.case.factors))
    limits = list(dict.fromkeys(name for result in results for row in result.rows for name in row.limits))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    verdicts = ("response_verdict", "vignette_verdict", "response_reason", "vignette_reason", "failure")
    writer.writerow(["case", "group", *factors, "method", *FIGURES, *limits, *verdicts])
    for result in results:
        for row in result.rows:
            figures = ["" if (v := getattr(row.figures, name)) is None else repr(v) for name in FIGURES]
            states = [said.get(part, "") for said in (row.states, row.reasons) for part in ("response", "vignette")]
            levels = [result.case.factors.get(name, "") for name in factors]
            bounds = [repr(row.limits[name]) if name in row.limits else "" for name in limits]
            writer.writerow(
                [result.case.name, result.case.group, *levels, row.method, *figures, *bounds, *states, row.failure]
            )
    return out.getvalue()


def _summary(title: str, results: Sequence[CaseResult]) -> Table:
    methods = methods_of(results)
    header = ["metric"]
    for method in methods:
        header += [f"{method}: typical", "worst"] if len(results) > 1 else [method]
    rows = []
    for metric in _known(results):
        row = [metric.label]
        for method in methods:
            found = spread(results, method, metric)
            typical = "–" if found is None else metric.text(found.typical)
            if found is not None and found.known < found.cases:
                typical += f" ({found.known} of {found.cases})"
            row += [typical] if len(results) == 1 else [typical, "–" if found is None else metric.text(found.worst)]
        rows.append(tuple(row))
    return Table(title, tuple(header), tuple(rows))


def _contests(title: str, results: Sequence[CaseResult]) -> Table:
    first, *others = methods_of(results)
    rows = []
    for metric in _known(results):
        if metric.kind != "error":
            continue
        found = {other: contest(results, first, other, metric.figure) for other in others}
        for outcome, members in _alike(found).items():
            if outcome.both + outcome.only_first + outcome.only_second:
                shares = (f"{outcome.nearer} of {outcome.both}", str(outcome.only_first), str(outcome.only_second))
                rows.append((metric.label, f"{first} against {members}", *shares))
    header = ("metric", "methods", "nearer", "only the first states it", "only the second")
    return Table(title, header, tuple(rows), names=2)


def _by_factor(title: str, results: Sequence[CaseResult]) -> Table:
    methods = methods_of(results)
    metrics = [m for m in _known(results) if m.figure in _BY_FACTOR]
    levels = list(dict.fromkeys(level for r in results for level in r.case.factors.items()))
    levels.sort(key=lambda level: list(results[0].case.factors).index(level[0]))
    rows = []
    for factor, level in levels:
        members = [r for r in results if r.case.factors.get(factor) == level]
        texts = {method: tuple(_typical(m, spread(members, method, m)) for m in metrics) for method in methods}
        rows += [(f"{factor} = {level}", names, *figures) for figures, names in _alike(texts).items()]
    return Table(title, ("level", "method", *(m.short for m in metrics)), tuple(rows), names=2)


def _rows(title: str, results: Sequence[CaseResult]) -> Table:
    metrics = _known(results)
    limits = list(dict.fromkeys(name for r in results for row in r.rows for name in row.limits))
    rows = [
        (
            result.case.name,
            row.method + (" (failed)" if row.failure else ""),
            *(m.text(getattr(row.figures, m.figure)) for m in metrics),
            *(f"{row.limits[name]:.4f}" if name in row.limits else "–" for name in limits),
        )
        for result in results
        for row in result.rows
    ]
    names = tuple(name.replace("_", " ") for name in limits)
    return Table(title, ("recording", "method", *(m.short for m in metrics), *names), tuple(rows), names=2)


def _alike(found: Mapping[str, _Outcome]) -> dict[_Outcome, str]:
    """Return every outcome once, with the names of the methods that share it."""
    members: dict[_Outcome, list[str]] = {}
    for name, outcome in found.items():
        members.setdefault(outcome, []).append(name)
    return {outcome: ", ".join(names) for outcome, names in members.items()}


def _typical(metric: Metric, found: Spread | None) -> str:
    return "–" if found is None else metric.text(found.typical)


def _known(results: Sequence[CaseResult]) -> list[Metric]:
    """Return the metrics that at least one row has."""
    rows = [row.figures for result in results for row in result.rows]
    return [m for m in METRICS if any(getattr(figures, m.figure) is not None for figures in rows)]
