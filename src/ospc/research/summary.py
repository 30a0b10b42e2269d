"""Measurements summarised: medians and worst cases of a method, and which of two methods came nearer to the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ospc.research.measurement import METRICS, Measurement, Metric


@dataclass(frozen=True)
class Spread:
    """A figure of a method over recordings.

    Attributes
    ----------
    typical, worst
        As :class:`~ospc.research.measurement.Metric` defines them.
    worst_case
        The recording with the worst figure.
    known, cases
        Number of recordings with this figure, and of all that the method was run on.
    """

    typical: float
    worst: float
    worst_case: str
    known: int
    cases: int


@dataclass(frozen=True)
class Contest:
    """Which of two methods came nearer to the truth.

    Attributes
    ----------
    nearer
        Recordings on which the first was nearer, of those with figures of both.
    both
        The number of those.
    only_first, only_second
        Recordings with a figure of one of them only.
    """

    nearer: int
    both: int
    only_first: int
    only_second: int


def methods_of(rows: Sequence[Measurement]) -> list[str]:
    """Return the methods in the order of their first measurement."""
    return list(dict.fromkeys(row.method for row in rows))


def groups_of(rows: Sequence[Measurement]) -> dict[str, list[Measurement]]:
    """Return the measurements by group, in the order of their first one."""
    groups: dict[str, list[Measurement]] = {}
    for row in rows:
        groups.setdefault(row.group, []).append(row)
    return groups


def known_metrics(rows: Sequence[Measurement]) -> list[Metric]:
    """Return the metrics that at least one measurement has."""
    return [metric for metric in METRICS if any(metric.figure in row.figures for row in rows)]


def spread(rows: Sequence[Measurement], method: str, metric: Metric) -> Spread | None:
    """Return a figure of a method over recordings; None where it is never known."""
    members = [row for row in rows if row.method == method]
    values = {row.recording: row.figures[metric.figure] for row in members if metric.figure in row.figures}
    if not values:
        return None
    worst = metric.worst(list(values.values()))
    name = next(name for name, value in values.items() if value == worst)
    return Spread(metric.typical(list(values.values())), worst, name, len(values), len(members))


def contest(rows: Sequence[Measurement], first: str, second: str, figure: str) -> Contest:
    """Return how often one method came nearer to the truth than another."""
    found = [
        {row.recording: row.figures.get(figure) for row in rows if row.method == name} for name in (first, second)
    ]
    pairs = [(found[0].get(name), found[1].get(name)) for name in dict.fromkeys(row.recording for row in rows)]
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    return Contest(
        sum(abs(a) < abs(b) for a, b in both),
        len(both),
        sum(a is not None and b is None for a, b in pairs),
        sum(a is None and b is not None for a, b in pairs),
    )


def medians(rows: Sequence[Measurement], figure: str) -> dict[str, float]:
    """Return the median of a figure by method, in which a missing figure counts as infinite."""
    return {
        name: float(np.median([row.figures.get(figure, math.inf) for row in rows if row.method == name]))
        for name in methods_of(rows)
    }
