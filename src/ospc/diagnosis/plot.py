"""A picture of what a check found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ospc.diagnosis.pixel_statistics import GREY_CELLS, RADIUS_CELLS
from ospc.diagnosis.report import RecordingReport
from ospc.errors import MissingExtraError, SettingError

_EXPOSURE_ROWS = 12


def plot_report(report: RecordingReport, path: str | Path) -> Path:
    """Draw brightness against exposure, the score of each lag, and what is covered; return the picture's path.

    Parameters
    ----------
    report
        What the check found.
    path
        Where to; the suffix says the kind of picture.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    SettingError
        If the picture cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("a plot", "plots") from None
    figure = Figure(figsize=(12, 7.5), layout="constrained")
    course, score, grey, radii = figure.subplots(2, 2, width_ratios=(2, 1)).flat
    _draw_course(report, course)
    _draw_score(report, score)
    _draw_grey(report, grey)
    _draw_radii(report, radii)
    lag = report.exposure_lag_frames
    figure.suptitle(
        f"{report.name}: {len(report.looked_at)} of {report.frames} frames, exposure lag "
        f"{'not determinable' if lag is None else f'{lag} frames'}"
    )
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise SettingError(f"{path}: the plot cannot be written ({error}); give a .png, .svg or .pdf") from None
    return Path(path)


def _draw_course(report: RecordingReport, axes: Any) -> None:
    """Draw the observed change of brightness and what the exposures explain of it, summed up within each run."""
    axes.set(
        title="Brightness of the same things, and what the exposures explain of it",
        xlabel="frame (runs put side by side)",
        ylabel="ln grey, from the start of each run",
    )
    fit, frame = report.lag.fit, report.lag.frame
    if fit is None or not len(frame):
        axes.text(0.5, 0.5, "too few frames could be compared", ha="center", transform=axes.transAxes)
        return
    pieces = np.split(np.arange(len(frame)), np.flatnonzero(np.diff(frame) != 1) + 1)
    place = 0
    for number, piece in enumerate(pieces):
        x = place + np.arange(len(piece) + 1)
        for values, style, label in (
            (fit.observed, {"color": "black", "lw": 1.4}, "observed"),
            (fit.explained, {"color": "tab:orange", "lw": 1.4, "ls": "--"}, "explained by exposures"),
            (fit.unexplained, {"color": "tab:red", "lw": 1}, "unexplained"),
        ):
            total = np.concatenate([[0.0], np.cumsum(values[piece])])
            axes.plot(x, total, label=label if number == 0 else None, **style)
        axes.annotate(f"{frame[piece[0]]}", (place, 0), xytext=(2, 2), textcoords="offset points", fontsize=7)
        place += len(piece) + 2
    axes.legend(fontsize="small", loc="best")
    axes.grid(alpha=0.3)


def _draw_score(report: RecordingReport, axes: Any) -> None:
    lag = report.lag
    axes.set(title=f"Lag of the exposures: {lag.state}", xlabel="lag in frames", ylabel="log likelihood below best")
    if not np.any(lag.score):
        axes.text(0.5, 0.5, "cannot be told", ha="center", transform=axes.transAxes)
        return
    colours = ["tab:green" if int(n) == lag.frames else "tab:grey" for n in lag.lags]
    axes.bar(lag.lags, lag.score, color=colours)
    best = int(np.argmax(lag.score))
    axes.plot(lag.lags[best], 0, "o", color=colours[best], clip_on=False, zorder=3)
    axes.set_xticks(lag.lags)
    # Few units decide; what is far below is only far below.
    axes.set_yscale("symlog", linthresh=10)
    axes.grid(alpha=0.3, axis="y")


def _draw_grey(report: RecordingReport, axes: Any) -> None:
    """Draw how often each grey level occurs at each exposure."""
    pixels = report.pixels
    low, high = float(pixels.log_exposure.min()), float(pixels.log_exposure.max())
    rows = _EXPOSURE_ROWS if high - low > 1e-3 else 1
    edge = np.linspace(low, high, rows + 1) if rows > 1 else np.array([low - 0.05, low + 0.05])
    row = np.clip(np.searchsorted(edge, pixels.log_exposure, side="right") - 1, 0, rows - 1)
    share = np.full((rows, GREY_CELLS), np.nan)
    for number in range(rows):
        if np.any(row == number):
            share[number] = pixels.grey_share[row == number].mean(axis=0)
    levels = np.linspace(0, pixels.max_grey, GREY_CELLS + 1)
    mesh = axes.pcolormesh(levels, np.exp(edge), np.sqrt(share), cmap="viridis", vmin=0)
    axes.figure.colorbar(mesh, ax=axes, label="√ share of pixels")
    axes.set_yscale("log")
    axes.set(title="Grey levels seen at each exposure", xlabel="grey value", ylabel="exposure in ms")


def _draw_radii(report: RecordingReport, axes: Any) -> None:
    share = report.pixels.mean_radius_share
    radius = (np.arange(RADIUS_CELLS) + 0.5) / RADIUS_CELLS
    axes.bar(radius, np.nan_to_num(share), width=0.9 / RADIUS_CELLS, color="tab:blue", alpha=0.7)
    reach = report.motion.radial_reach
    axes.annotate(
        "", xy=(min(reach, 1.0), 1.06), xytext=(0, 1.06), arrowprops={"arrowstyle": "|-|", "color": "tab:red"}
    )
    axes.text(min(reach, 1.0) + 0.02, 1.04, f"radial motion {reach:.2f}", color="tab:red", fontsize="small")
    axes.set(
        title="Well exposed share of each radius",
        xlabel="R (1 = corner)",
        ylabel="share of places",
        xlim=(0, 1),
        ylim=(0, 1.15),
    )
    axes.grid(alpha=0.3)
