"""Results drawn together: medians and worst cases per method, and which method came nearer to the truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ospc.benchmark.case import Case, Group, Row

Kind = Literal["error", "bias", "share"]


@dataclass(frozen=True)
class Metric:
    """How a figure is called, summarised and written.

    Attributes
    ----------
    figure
        Name of the attribute of :class:`~ospc.benchmark.case.Figures`.
    label, short
        What to call it where there is room, and at the head of a column.
    kind
        "error" is the better the smaller, "bias" the nearer to zero, "share" is a coverage.
    digits
        Digits after the point; of a share, in percent.
    """

    figure: str
    label: str
    short: str
    kind: Kind = "error"
    digits: int = 4

    def text(self, value: float | None) -> str:
        """Return a value as a table shows it."""
        if value is None:
            return "–"
        if self.kind == "share":
            return f"{value:.{self.digits}%}"
        return f"{value:{'+' if self.kind == 'bias' else ''}.{self.digits}f}"

    def typical(self, values: Sequence[float]) -> float:
        """Return the median; of shares, whose points are pooled, the mean."""
        return float(np.mean(values) if self.kind == "share" else np.median(values))

    def worst(self, values: Sequence[float]) -> float:
        """Return the largest error, the bias farthest from zero, or the smallest share."""
        if self.kind == "share":
            return min(values)
        return max(values, key=abs)


METRICS = (
    Metric("response_rmse", "response, RMSE of g", "g"),
    Metric("response_shape_rmse", "response, RMSE of its shape", "shape"),
    Metric("log_ratio_error", "response, log-ratio error κ", "κ"),
    Metric("vignette_rmse", "vignette, RMSE of the profile", "V"),
    Metric("vignette_pixel_rmse", "vignette, RMSE of all pixels", "V pixels"),
    Metric("ratio_median_abs", "ln k, median error", "ln k"),
    Metric("ratio_bias", "ln k, bias", "bias", "bias"),
    Metric("factor_error_percent", "exposure factor, error in %", "factor %", digits=2),
    Metric("response_within_1_sigma", "response within ±1σ", "g ±1σ", "share", 0),
    Metric("response_within_2_sigma", "response within ±2σ", "g ±2σ", "share", 0),
    Metric("vignette_within_1_sigma", "vignette within ±1σ", "V ±1σ", "share", 0),
    Metric("vignette_within_2_sigma", "vignette within ±2σ", "V ±2σ", "share", 0),
)


@dataclass(frozen=True)
class CaseResult:
    """A case with the rows of all presets that are finished."""

    case: Case
    rows: tuple[Row, ...]

    def value(self, method: str, figure: str) -> float | None:
        """Return a figure of a method; None where it has none."""
        for row in self.rows:
            if row.method == method:
                found: float | None = getattr(row.figures, figure)
                return found
        return None


@dataclass(frozen=True)
class Spread:
    """A figure of a method over the cases of a group.

    Attributes
    ----------
    typical, worst
        As the metric defines them.
    worst_case
        The case the worst belongs to.
    known, cases
        Number of cases the figure is known for, and the method was run on.
    """

    typical: float
    worst: float
    worst_case: str
    known: int
    cases: int


@dataclass(frozen=True)
class Contest:
    """Of two methods, which came nearer to the truth.

    Attributes
    ----------
    nearer
        Cases that the first was nearer in, among those both have a figure for.
    both
        Those.
    only_first, only_second
        Cases that only one of them has a figure for.
    """

    nearer: int
    both: int
    only_first: int
    only_second: int


def groups_of(results: Iterable[CaseResult]) -> list[Group]:
    """Return the groups in the order of their first case."""
    return list(dict.fromkeys(result.case.group for result in results))


def methods_of(results: Iterable[CaseResult]) -> list[str]:
    """Return the methods in the order of their first row."""
    return list(dict.fromkeys(row.method for result in results for row in result.rows))


def spread(results: Iterable[CaseResult], method: str, metric: Metric) -> Spread | None:
    """Return a figure of a method over cases; None where it is never known."""
    ran = [r for r in results if any(row.method == method for row in r.rows)]
    values = {r.case.name: value for r in ran if (value := r.value(method, metric.figure)) is not None}
    if not values:
        return None
    worst = metric.worst(list(values.values()))
    name = next(name for name, value in values.items() if value == worst)
    return Spread(metric.typical(list(values.values())), worst, name, len(values), len(ran))


def contest(results: Iterable[CaseResult], first: str, second: str, figure: str) -> Contest:
    """Return how often one method came nearer to the truth than another."""
    pairs = [(r.value(first, figure), r.value(second, figure)) for r in results]
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    return Contest(
        sum(abs(a) < abs(b) for a, b in both),
        len(both),
        sum(a is not None and b is None for a, b in pairs),
        sum(a is None and b is not None for a, b in pairs),
    )
