"""The pictures of a calibration, each by the name of its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ospc.formats.opening import Photometry
from ospc.photometry.calibration import Calibration
from ospc.report.panels import draw_exposures, draw_response, draw_vignette
from ospc.report.style import new_figure, rules, save

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
    figure = new_figure(13.0, 4.4) if name == "figure.png" else new_figure(6.4, 4.8)
    true_response = None if truth is None else truth.response
    true_vignette = None if truth is None else truth.vignette
    with rules():
        if name == "figure.png":
            left, middle, right = figure.subplots(1, 3)
            draw_response(left, calibration, true_response)
            draw_vignette(middle, calibration, true_vignette)
            draw_exposures(right, calibration)
            figure.suptitle(_title(calibration), fontsize=10)
        elif name == "plot_response.png":
            draw_response(figure.subplots(), calibration, true_response)
        elif name == "plot_vignette.png":
            _vignette_picture(figure, calibration, truth)
        else:
            draw_exposures(figure.subplots(), calibration)
        return save(figure, path)


def _vignette_picture(figure: Any, calibration: Calibration, truth: Photometry | None) -> None:
    draw_vignette(figure.subplots(), calibration, None if truth is None else truth.vignette)


def _title(calibration: Calibration) -> str:
    counts = calibration.counts
    parts = [str(calibration.source.get("name", "")), f"{calibration.size[0]}×{calibration.size[1]} pixels"]
    if "frames" in counts:
        parts.append(f"{counts['frames']} frames")
    if calibration.partial:
        parts.append("partial: interrupted before the end")
    return "   ·   ".join(part for part in parts if part)
