"""The pictures of a calibration, each by the name of its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ospc.formats.opening import Photometry
from ospc.photometry.calibration import Calibration
from ospc.report.panels import (
    draw_exposures,
    draw_exposures_over_time,
    draw_response,
    draw_response_error,
    draw_vignette,
    draw_vignette_error,
    draw_vignette_map,
)
from ospc.report.style import ORANGE, new_figure, rules, save

_SIZES_IN = {
    "figure.png": (14.0, 5.2),
    "plot_response.png": (6.4, 6.0),
    "plot_vignette.png": (11.0, 5.2),
    "plot_exposures.png": (11.0, 5.0),
}

PICTURES = ("figure.png", "plot_response.png", "plot_vignette.png", "plot_exposures.png")
"""File names: an overview like the paper's figure 3, and its three panels on their own."""


def write_picture(name: str, calibration: Calibration, path: Path, truth: Photometry | None = None) -> Path | None:
    """Draw one of :data:`PICTURES` and return its path, or None where what it shows is not known.

    Parameters
    ----------
    name
        Which one.
    calibration
        What to draw.
    path
        Where to write it.
    truth
        What to draw beside it.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    FormatError
        If it cannot be written.
    """
    known = {
        "figure.png": True,
        "plot_response.png": calibration.response is not None,
        "plot_vignette.png": calibration.vignette is not None,
        "plot_exposures.png": calibration.exposure_ratios.metadata.size > 0,
    }[name]
    if not known:
        return None
    return _drawn(name, calibration, path, truth)


def _drawn(name: str, calibration: Calibration, path: Path, truth: Photometry | None) -> Path:
    figure = new_figure(*_SIZES_IN[name])
    with rules():
        if name == "figure.png":
            _overview(figure, calibration, truth)
        elif name == "plot_response.png":
            upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
            _response(upper, lower, calibration, truth)
        elif name == "plot_vignette.png":
            _vignette_picture(figure, calibration, truth)
        else:
            left, right = figure.subplots(1, 2)
            draw_exposures(left, calibration)
            draw_exposures_over_time(right, calibration)
        _label(figure, calibration)
        return save(figure, path)


def _label(figure: Any, calibration: Calibration) -> None:
    """Say under the picture what it must not be taken for."""
    if calibration.exponent_sigma:
        figure.supxlabel(
            "No exposures were known: response, vignette and exposures are estimated up to one common exponent γ "
            f"(ln γ ± {calibration.exponent_sigma:.2f})",
            fontsize=8.5,
            color=ORANGE,
        )


def _overview(figure: Any, calibration: Calibration, truth: Photometry | None) -> None:
    figure.suptitle(_title(calibration), fontsize=10)
    grid = figure.add_gridspec(2, 3, height_ratios=(3, 1))
    _response(*_two_rows(figure, grid, 0), calibration, truth)
    _vignette(*_two_rows(figure, grid, 1), calibration, truth)
    draw_exposures(figure.add_subplot(grid[:, 2]), calibration)


def _two_rows(figure: Any, grid: Any, column: int) -> tuple[Any, Any]:
    return figure.add_subplot(grid[0, column]), figure.add_subplot(grid[1, column])


def _response(upper: Any, lower: Any, calibration: Calibration, truth: Photometry | None) -> None:
    draw_response(upper, calibration, None if truth is None else truth.response)
    draw_response_error(lower, calibration, None if truth is None else truth.response)
    _join(upper, lower)


def _vignette(upper: Any, lower: Any, calibration: Calibration, truth: Photometry | None) -> None:
    draw_vignette(upper, calibration, None if truth is None else truth.vignette)
    draw_vignette_error(lower, calibration, None if truth is None else truth.vignette)
    _join(upper, lower)


def _join(upper: Any, lower: Any) -> None:
    """Name the common axis once, or give all room to the upper panel if the lower one shows nothing."""
    if lower.get_visible():
        upper.set(xlabel="")
        return
    lower.remove()
    grid = upper.get_subplotspec().get_gridspec()
    upper.set_subplotspec(grid[:, upper.get_subplotspec().colspan.start])


def _vignette_picture(figure: Any, calibration: Calibration, truth: Photometry | None) -> None:
    grid = figure.add_gridspec(2, 2, height_ratios=(3, 1))
    _vignette(figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0]), calibration, truth)
    if calibration.vignette is not None:
        draw_vignette_map(figure.add_subplot(grid[:, 1]), calibration.vignette)


def _title(calibration: Calibration) -> str:
    counts = calibration.counts
    parts = [str(calibration.source.get("name", "")), f"{calibration.size[0]}×{calibration.size[1]} pixels"]
    if "frames" in counts:
        parts.append(f"{counts['frames']} frames")
    if calibration.partial:
        parts.append("partial: interrupted before the end")
    return "   ·   ".join(part for part in parts if part)
