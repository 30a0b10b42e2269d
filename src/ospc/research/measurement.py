"""Errors of one method on one recording, how they are named and printed, and their summaries over recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

Kind = Literal["error", "bias", "share"]


@dataclass(frozen=True)
class Metric:
    """How a figure, a key of :attr:`Measurement.figures`, is named, summarised and printed.

    ``label`` is the full name, ``short`` a column heading. An "error" is best when small, a "bias" when near zero. A
    "share" is the coverage of a confidence band, printed in percent with ``digits`` decimals.
    """

    figure: str
    label: str
    short: str
    kind: Kind = "error"
    digits: int = 4

    def text(self, value: float | None) -> str:
        """Return a value as tables print it."""
        if value is None or not np.isfinite(value):
            return "–"
        if self.kind == "share":
            return f"{value:.{self.digits}%}"
        return f"{value:{'+' if self.kind == 'bias' else ''}.{self.digits}f}"

    def typical(self, values: Sequence[float]) -> float:
        """Return the median, or for shares the mean, which pools their points."""
        return float(np.mean(values) if self.kind == "share" else np.median(values))

    def worst(self, values: Sequence[float]) -> float:
        """Return the largest error, the bias furthest from zero, or the smallest share."""
        return min(values) if self.kind == "share" else max(values, key=abs)


METRICS = (
    Metric("response_rmse", "response, RMSE of g", "g"),
    Metric("response_shape_rmse", "response shape, RMSE of s·g", "shape"),
    Metric("log_ratio_error", "log-ratio error κ", "κ"),
    Metric("vignette_rmse", "vignette, RMSE of the profile", "V"),
    Metric("vignette_pixel_rmse", "vignette, RMSE of all pixels", "V pixels"),
    Metric("ratio_median_abs", "ln k, median error", "ln k"),
    Metric("ratio_bias", "ln k, bias", "bias", "bias"),
    Metric("exposure_error", "exposures, RMSE of ln e", "ln e"),
    Metric("response_within_1_sigma", "response within ±1σ", "g ±1σ", "share", 0),
    Metric("response_within_2_sigma", "response within ±2σ", "g ±2σ", "share", 0),
    Metric("vignette_within_1_sigma", "vignette within ±1σ", "V ±1σ", "share", 0),
    Metric("vignette_within_2_sigma", "vignette within ±2σ", "V ±2σ", "share", 0),
)
"""All figures, in the order of the tables; :mod:`ospc.research.scoring` computes them."""


def metrics(*figures: str) -> tuple[Metric, ...]:
    """Return the metrics of the named figures."""
    return tuple(metric for metric in METRICS if metric.figure in figures)


@dataclass(frozen=True)
class Measurement:
    """One method on one recording.

    Attributes
    ----------
    figures, failure
        Known errors by :attr:`Metric.figure`; the error that ended the method, empty if none did.
    group, factors
        The group of the recording, and its level of each factor that varies within the group.
    states, reasons
        Verdicts by quantity, and their reasons.
    limits
        Limits of the comparison itself: how uncertain the truth is, how wrong the stated exposures are.
    curves, ratios
        For plots: "response", g at 256 grey levels, and "vignette", the mean of V in 50 rings; the exposure ratios
        that a calibration reports, as lists "frames", "metadata", "estimated" and "samples".
    """

    recording: str
    method: str
    figures: dict[str, float] = field(default_factory=dict)
    failure: str = ""
    group: str = ""
    factors: dict[str, str] = field(default_factory=dict)
    states: dict[str, str] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    curves: dict[str, list[float]] = field(default_factory=dict, repr=False)
    ratios: dict[str, list[Any]] = field(default_factory=dict, repr=False)

    @property
    def problem(self) -> str:
        """The reason why there are no figures; empty if there are some."""
        if self.figures:
            return ""
        return self.failure or "; ".join(self.reasons.values()) or "it found neither response nor vignette"


@dataclass(frozen=True)
class Spread:
    """Typical and worst figure over recordings (see :class:`Metric`), known for ``known`` of ``cases``."""

    typical: float
    worst: float
    worst_case: str
    known: int
    cases: int


def methods_of(rows: Sequence[Measurement]) -> list[str]:
    """Return the methods in order of their first measurement."""
    return list(dict.fromkeys(row.method for row in rows))


def recordings_of(rows: Sequence[Measurement]) -> list[str]:
    """Return the recordings in order of their first measurement."""
    return list(dict.fromkeys(row.recording for row in rows))


def groups_of(rows: Sequence[Measurement]) -> dict[str, list[Measurement]]:
    """Return the measurements by the group of their recording."""
    groups: dict[str, list[Measurement]] = {}
    for row in rows:
        groups.setdefault(row.group, []).append(row)
    return groups


def known_metrics(rows: Sequence[Measurement]) -> list[Metric]:
    """Return the metrics that at least one measurement has."""
    return [metric for metric in METRICS if any(metric.figure in row.figures for row in rows)]


def spread(rows: Sequence[Measurement], method: str, metric: Metric) -> Spread | None:
    """Summarise a figure of a method over recordings; None if it is never known."""
    members = [row for row in rows if row.method == method]
    values = {row.recording: row.figures[metric.figure] for row in members if metric.figure in row.figures}
    if not values:
        return None
    worst = metric.worst(list(values.values()))
    name = next(name for name, value in values.items() if value == worst)
    return Spread(metric.typical(list(values.values())), worst, name, len(values), len(members))


def medians(rows: Sequence[Measurement], figure: str) -> dict[str, float]:
    """Return the median of a figure by method; a missing figure counts as infinite.

    Groups of recordings in which no method has the figure are left out: their truth is unknown.
    """
    groups = {row.group for row in rows if figure in row.figures}
    judged = [row for row in rows if row.group in groups]
    found = {
        name: [row.figures.get(figure, math.inf) for row in judged if row.method == name] for name in methods_of(rows)
    }
    return {name: float(np.median(values)) if values else math.inf for name, values in found.items()}
