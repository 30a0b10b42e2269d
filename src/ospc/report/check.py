"""The plot of a check."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ospc.diagnosis.report import RecordingReport
from ospc.errors import counted
from ospc.report.curves import RADIUS_LABEL, logarithmic
from ospc.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, new_figure, printable, rules, save
from ospc.settings.grey_values import COVERAGE_GREY_CELLS, COVERAGE_RADIUS_CELLS

_EXPOSURE_ROWS = 12
"""Number of exposure classes."""
_SAME_EXPOSURE = 1e-3
"""Range of ln exposure below which there is only one class."""
_DECIDING = 10
"""Difference in log likelihood up to which the axis is linear; all larger ones are decisive."""


def plot_report(report: RecordingReport, path: str | Path) -> Path:
    """Draw brightness and exposure, the score of each lag, and the coverage; return the path of the picture."""
    lag = report.exposure_lag_frames
    title = (
        f"{report.name}: {report.processed} of {counted(report.frames, 'frame')}, exposure lag "
        f"{'not determined' if lag is None else counted(lag, 'frame')}"
    )
    with rules():
        figure = new_figure(11, 7)
        brightness, score, grey, radii = figure.subplots(2, 2, width_ratios=(2, 1)).flat
        _draw_brightness(report, brightness)
        _draw_score(report, score)
        _draw_grey(report, grey)
        _draw_radii(report, radii)
        figure.suptitle(printable(title), fontsize=10, parse_math=False)
        return save(figure, Path(path))


def _draw_brightness(report: RecordingReport, axes: Any) -> None:
    """Draw the observed change of brightness and the part explained by the exposures, accumulated within each run."""
    axes.set(
        title="Brightness of the same scene points, and the part explained by the exposures",
        xlabel="frame (consecutive runs, each labelled with its first frame)",
        ylabel="ln grey level, relative to the start of the run",
    )
    fit, frame = report.exposures.lag.fit, report.exposures.lag.frame
    if fit is None or not len(frame):
        axes.text(0.5, 0.5, "too few frames could be compared", ha="center", transform=axes.transAxes)
        return
    runs = np.split(np.arange(len(frame)), np.flatnonzero(np.diff(frame) != 1) + 1)
    place = 0
    for number, run in enumerate(runs):
        x = place + np.arange(len(run) + 1)
        for values, style, label in (
            (fit.observed, {"color": BLACK, "lw": 1.4}, "observed"),
            (fit.explained, {"color": ORANGE, "lw": 1.4, "ls": "--"}, "explained by the exposures"),
            (fit.unexplained, {"color": BLUE, "lw": 1, "ls": "-."}, "unexplained"),
        ):
            total = np.concatenate([[0.0], np.cumsum(values[run])])
            axes.plot(x, total, label=label if number == 0 else None, **style)
        axes.annotate(f"{frame[run[0]]}", (place, 0), xytext=(2, 2), textcoords="offset points", fontsize=7)
        place += len(run) + 2
    axes.legend(loc="best")


def _draw_score(report: RecordingReport, axes: Any) -> None:
    lag = report.exposures.lag
    axes.set(
        title=f"Lag of the exposures: {lag.state}",
        xlabel="lag in frames",
        ylabel="log likelihood relative to the best",
    )
    if not np.any(lag.score):
        axes.text(0.5, 0.5, "cannot be determined", ha="center", transform=axes.transAxes)
        return
    colours = [GREEN if int(n) == lag.frames else GREY for n in lag.lags]
    axes.bar(lag.lags, lag.score, color=colours)
    best = int(np.argmax(lag.score))
    axes.plot(lag.lags[best], 0, "o", color=colours[best], clip_on=False, zorder=3)
    axes.set_xticks(lag.lags)
    axes.set_yscale("symlog", linthresh=_DECIDING)
    axes.yaxis.set_major_formatter(lambda value, _position: f"{value:g}")


def _draw_grey(report: RecordingReport, axes: Any) -> None:
    """Draw how often each grey level occurs at each exposure."""
    pixels = report.pixels
    low, high = float(pixels.log_exposure.min()), float(pixels.log_exposure.max())
    if high - low > _SAME_EXPOSURE:
        edges = np.linspace(low, high, _EXPOSURE_ROWS + 1)
    else:
        edges = np.array([low - 0.05, low + 0.05])
    row = np.clip(np.searchsorted(edges, pixels.log_exposure, side="right") - 1, 0, len(edges) - 2)
    share = np.full((len(edges) - 1, COVERAGE_GREY_CELLS), np.nan)
    for number in np.unique(row):
        share[number] = pixels.grey_share[row == number].mean(axis=0)
    levels = np.linspace(0, pixels.max_grey, COVERAGE_GREY_CELLS + 1)
    mesh = axes.pcolormesh(levels, np.exp(edges), np.sqrt(share), cmap="viridis", vmin=0)
    axes.figure.colorbar(mesh, ax=axes, label="√ share of pixels")
    logarithmic(axes, "y", float(np.exp(edges[0])), float(np.exp(edges[-1])))
    axes.set(title="Grey levels at each exposure", xlabel="grey level M", ylabel="exposure in ms")
    axes.grid(visible=False)


def _draw_radii(report: RecordingReport, axes: Any) -> None:
    share = report.pixels.mean_radius_share
    radius = (np.arange(COVERAGE_RADIUS_CELLS) + 0.5) / COVERAGE_RADIUS_CELLS
    axes.bar(radius, np.nan_to_num(share), width=0.9 / COVERAGE_RADIUS_CELLS, color=BLUE, alpha=0.7)
    radial = report.motion.radial_motion
    axes.annotate(
        "", xy=(min(radial, 1.0), 1.06), xytext=(0, 1.06), arrowprops={"arrowstyle": "|-|", "color": ORANGE}
    )
    axes.text(min(radial, 0.5) + 0.02, 1.09, f"radial motion {radial:.2f}", color=ORANGE, fontsize=8)
    axes.set(
        title="Well-exposed share at each radius",
        xlabel=RADIUS_LABEL,
        ylabel="share of pixels",
        xlim=(0, 1),
        ylim=(0, 1.2),
    )
