"""Pictures of experiments, drawn like the paper's figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ospc.experiments.ambiguity import Ambiguity
from ospc.experiments.design import Experiment
from ospc.experiments.measuring import TITLES, Measured, Measurement, medians
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.vignette import radial_profile
from ospc.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, new_figure, rules, save

_COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#56B4E9", "#E69F00", "#8B4513", "#4B0082")
_LINES = ("-", "--", "-.", ":")
_FEWEST_SAMPLES = 10
"""Exposure ratios that rest on fewer scene points are not shown."""


def draw_curves(measured: Measured, path: Path, ratios: dict[str, ExposureRatios] | None = None) -> Path:
    """Draw the responses, vignettes and, where given, exposure ratios found on one recording, beside the truth.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    shown = {name: found for name, found in (ratios or {}).items() if np.any(found.samples >= _FEWEST_SAMPLES)}
    figure = new_figure(15.0 if shown else 10.0, 4.6)
    with rules():
        axes = figure.subplots(1, 3 if shown else 2)
        figure.suptitle(measured.source.name)
        truth = measured.source.truth
        everything = [("truth", truth), *measured.found.items()]
        for number, (name, photometry) in enumerate(everything):
            look = {"label": name, **_look(number)}
            if photometry.response is not None:
                greys = np.arange(256)
                axes[0].plot(greys, photometry.response.inverse(greys / 255), **look)
            if photometry.vignette is not None:
                profile = radial_profile(photometry.vignette)
                axes[1].plot((np.arange(profile.size) + 0.5) / profile.size, profile / profile[:3].mean(), **look)
        axes[0].set(title="Inverse response", xlabel="grey value", ylabel="g, relative irradiance", xlim=(0, 255))
        axes[1].set(title="Vignette", xlabel="R (1 = corner)", ylabel="V, relative to the centre", xlim=(0, 1))
        if shown:
            _draw_ratios(axes[2], shown)
        for axis in axes:
            if axis.lines:
                axis.legend(loc="best")
        return save(figure, path)


def _draw_ratios(axes: Any, ratios: dict[str, ExposureRatios]) -> None:
    kept = {name: found.samples >= _FEWEST_SAMPLES for name, found in ratios.items()}
    everything = np.concatenate(
        [np.concatenate([found.metadata[kept[name]], found.estimated[kept[name]]]) for name, found in ratios.items()]
    )
    ends = [float(np.quantile(everything, q)) for q in (0.001, 0.999)]
    axes.plot(ends, ends, color=BLACK, lw=1, label="equal")
    for (name, found), colour in zip(ratios.items(), _COLOURS, strict=False):
        k, estimate = found.metadata[kept[name]], found.estimated[kept[name]]
        axes.scatter(k, estimate, s=7, alpha=0.5, color=colour, label=name, linewidths=0)
    axes.set(
        title="Exposure ratios",
        xlabel="k by the metadata",
        ylabel="k by grey values",
        xscale="log",
        yscale="log",
        xlim=ends,
        ylim=ends,
    )


def _look(number: int) -> dict[str, Any]:
    """Return colour, dashes and width of the truth (0) and of the methods after it."""
    if number == 0:
        return {"color": BLACK, "lw": 3.0, "alpha": 0.45}
    place = number - 1
    return {"color": _COLOURS[place % len(_COLOURS)], "ls": _LINES[place % len(_LINES)], "lw": 1.5}


def draw_errors(experiment: Experiment, rows: Sequence[Measurement], path: Path) -> Path:
    """Draw every recording's figure of merit by method and their medians, or over what is varied.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    middle = medians(rows, experiment.figure)
    figure = new_figure(7.5, 4.6)
    with rules():
        axes = figure.subplots()
        places = {name: experiment.varied.get(name, float(number)) for number, name in enumerate(middle)}
        for row in rows:
            value = row.value(experiment.figure)
            if math.isfinite(value):
                axes.plot(places[row.method], value, "o", color=GREY, ms=4, alpha=0.7)
        finite = {name: value for name, value in middle.items() if math.isfinite(value)}
        xs, ys = [places[name] for name in finite], list(finite.values())
        if experiment.varied:
            axes.plot(xs, ys, "-o", color=BLUE, ms=6, label="median")
            axes.set(xlabel=experiment.axis)
        else:
            axes.plot(xs, ys, "_", color=BLUE, ms=28, mew=3, label="median")
            axes.set_xticks(list(places.values()), list(places), rotation=20, ha="right")
            axes.set_xlim(-0.6, len(places) - 0.4)
        for x, (name, value) in zip(xs, finite.items(), strict=True):
            del name
            axes.annotate(f"{value:.3g}", (x, value), xytext=(8, 6), textcoords="offset points", fontsize=8)
        positive = any(0 < row.value(experiment.figure) < math.inf for row in rows)
        axes.set(yscale="log" if positive else "linear", ylabel=TITLES[experiment.figure], title=experiment.title)
        axes.legend(loc="best")
        return save(figure, path)


def draw_ambiguity(found: Ambiguity, path: Path, name: str) -> Path:
    """Draw what powers of the truth leave unexplained, and where joint estimation ends by where it begins.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    figure = new_figure(11.0, 4.4)
    with rules():
        figure.suptitle(name)
        left, right = figure.subplots(1, 2)
        left.plot(found.exponents, 255 * found.free, color=ORANGE, lw=2, label="exposures free: e^γ")
        left.plot(found.exponents, 255 * found.known, color=BLUE, ls="--", lw=2, label="exposures known: e")
        left.axvline(1, color=GREY, lw=1)
        left.set(
            xscale="log",
            xlabel="exponent γ of response and vignette",
            ylabel="unexplained, grey levels",
            title="Every exponent explains as much, until e is known",
            ylim=(0, None),
        )
        left.legend(loc="best")
        right.plot(found.starts, found.reached, "o-", color=ORANGE, label="joint estimation")
        right.axhline(1, color=GREY, lw=1, label="truth")
        right.set(
            xscale="log",
            yscale="log",
            xlabel="exponent where it begins",
            ylabel="exponent of its result",
            title="Where joint estimation ends depends on its beginning",
        )
        ticks = [0.35, 0.5, 0.7, 1, 1.4, 2, 2.8]
        for axis in (left, right):
            axis.set_xticks(ticks[1:-1], [f"{tick:g}" for tick in ticks[1:-1]])
            axis.minorticks_off()
        right.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        right.minorticks_off()
        right.legend(loc="best")
        return save(figure, path)
