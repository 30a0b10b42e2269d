"""Plots of measurements as matplotlib figures: errors by method, curves with the truth, exposure ratios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ospc.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, new_figure, printable
from ospc.research.measurement import Measurement, Metric, medians

_COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#56B4E9", "#E69F00", "#8B4513", "#4B0082")
_LINES = ("-", "--", "-.", ":")
_FEWEST_SAMPLES = 10
"""Exposure ratios from fewer scene points are not drawn."""
_PANEL_IN = (7.5, 4.6)
"""Width and height of one panel of errors, in inches."""


def line_style(number: int) -> dict[str, Any]:
    """Return colour, dashes and width of the line with this number."""
    return {"color": _COLOURS[number % len(_COLOURS)], "ls": _LINES[number % len(_LINES)], "lw": 1.5}


def figure_of_panels(count: int, most_columns: int, panel_in: tuple[float, float]) -> tuple[Any, list[Any]]:
    """Return a figure with ``count`` panels in rows of at most ``most_columns``."""
    columns = min(most_columns, max(1, count))
    lines = max(1, -(-count // columns))
    figure = new_figure(panel_in[0] * columns, panel_in[1] * lines)
    panels = list(np.atleast_1d(figure.subplots(lines, columns)).ravel())
    for axes in panels[count:]:
        axes.set_visible(False)
    return figure, panels[:count]


def draw_errors(
    title: str,
    metrics: Sequence[Metric],
    rows: Sequence[Measurement],
    *,
    varied: Mapping[str, float] | None = None,
    axis: str = "",
) -> Any:
    """Draw the errors of all recordings and their medians by method, with one panel for each metric.

    If the methods differ only in the value of one setting, ``varied`` maps their names to that value, and ``axis`` is
    its label.
    """
    figure, panels = figure_of_panels(len(metrics), 2, _PANEL_IN)
    figure.suptitle(title)
    for axes, metric in zip(panels, metrics, strict=True):
        _draw_panel(axes, metric, rows, varied or {})
        if varied:
            axes.set(xlabel=axis)
    return figure


def _draw_panel(axes: Any, metric: Metric, rows: Sequence[Measurement], varied: Mapping[str, float]) -> None:
    middle = medians(rows, metric.figure)
    places = {name: varied.get(name, float(number)) for number, name in enumerate(middle)}
    values = [(places[row.method], row.figures[metric.figure]) for row in rows if metric.figure in row.figures]
    if values:
        axes.plot(*zip(*values, strict=True), "o", color=GREY, ms=4, alpha=0.7)
    finite = {name: value for name, value in middle.items() if np.isfinite(value)}
    xs, ys = [places[name] for name in finite], list(finite.values())
    if varied:
        axes.plot(xs, ys, "-o", color=BLUE, ms=6, label="median")
    else:
        axes.plot(xs, ys, "_", color=BLUE, ms=28, mew=3, label="median")
        axes.set_xticks(list(places.values()), list(places), rotation=20, ha="right")
        axes.set_xlim(-0.6, len(places) - 0.4)
    for x, y in zip(xs, ys, strict=True):
        axes.annotate(f"{y:.3g}", (x, y), xytext=(8, 6), textcoords="offset points", fontsize=8)
    axes.set(yscale="log" if any(value > 0 for _, value in values) else "linear", ylabel=metric.label)
    axes.legend(loc="best")


def draw_curves(title: str, curves: Mapping[str, Mapping[str, Sequence[float]]], rows: Sequence[Measurement]) -> Any:
    """Draw the responses and vignettes of one recording, the truth first, and the exposure ratios of ``rows``."""
    ratios = {}
    for row in rows:
        table = np.array(
            [row.ratios.get(name, []) for name in ("metadata", "estimated", "samples")], dtype=np.float64
        )
        if np.any(reliable := table[2] >= _FEWEST_SAMPLES):
            ratios[row.method] = table[:2, reliable].T
    figure = new_figure(15.0 if ratios else 10.0, 4.6)
    axes = figure.subplots(1, 3 if ratios else 2)
    figure.suptitle(printable(title), parse_math=False)
    for number, (name, parts) in enumerate(curves.items()):
        style = {"color": BLACK, "lw": 3.0, "alpha": 0.45} if number == 0 else line_style(number - 1)
        if "response" in parts:
            axes[0].plot(np.arange(256), parts["response"], label=name, **style)
        if "vignette" in parts:
            rings = len(parts["vignette"])
            axes[1].plot((np.arange(rings) + 0.5) / rings, parts["vignette"], label=name, **style)
    axes[0].set(title="Inverse response", xlabel="grey value", ylabel="g, relative irradiance", xlim=(0, 255))
    axes[1].set(title="Vignette", xlabel="R (1 = corner)", ylabel="V, relative to the centre", xlim=(0, 1))
    if ratios:
        _draw_ratios(axes[2], ratios)
    for axis in axes:
        if axis.lines:
            axis.legend(loc="best")
    return figure


def _draw_ratios(axes: Any, ratios: Mapping[str, Any]) -> None:
    # A few outliers would squeeze all other ratios into a corner.
    ends = np.quantile(np.concatenate(list(ratios.values())), [0.001, 0.999]).tolist()
    axes.plot(ends, ends, color=BLACK, lw=1, label="equal")
    for (name, found), colour in zip(ratios.items(), _COLOURS, strict=False):
        axes.scatter(*found.T, s=7, alpha=0.5, color=colour, label=name, linewidths=0)
    axes.set(title="Exposure ratios", xlabel="k of the metadata", ylabel="k of the grey values")
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
