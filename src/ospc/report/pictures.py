"""The pictures of a calibration that are written as PNG files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ospc.arrays import FloatArray
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import Calibration
from ospc.report.charts import Findings, charts_of
from ospc.report.style import ORANGE, new_figure, printable, rules, save

_CONTENT = {
    "figure.png": ("response", "vignette", "ratios"),
    "plot_response.png": ("response",),
    "plot_vignette.png": ("vignette", "vignette map"),
    "plot_exposures.png": ("exposures", "ratios"),
}

PICTURES = tuple(_CONTENT)
"""File names: an overview like figure 3 of the paper, and its three parts on their own."""

_HEIGHT_IN, _CHART_IN = 4.2, 3.1
_MARGIN_IN = {"left": 0.78, "right": 0.15, "top": 0.62, "bottom": 0.72, "between": 0.85}
"""Room around and between the charts for titles and labels."""


def write_picture(
    name: str,
    calibration: Calibration,
    path: Path,
    truth: Photometry | None = None,
    exposures_ms: FloatArray | None = None,
) -> Path | None:
    """Draw one of :data:`PICTURES` and return its path, or None where what it shows is unknown.

    Parameters
    ----------
    name
        Which one.
    calibration
        The calibration.
    path
        Where to write it.
    truth
        A reference to draw beside it.
    exposures_ms
        Exposure of every frame according to the metadata, shape (frames,); None where unknown.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    known = {
        "figure.png": True,
        "plot_response.png": calibration.response is not None,
        "plot_vignette.png": calibration.vignette is not None,
        "plot_exposures.png": calibration.exposure_ratios.metadata.size > 0,
    }
    if not known[name]:
        return None
    available = charts_of(Findings(calibration, exposures_ms, truth=truth))
    charts = [available[part] for part in _CONTENT[name] if part in available]
    with rules():
        figure, grid = _row(len(charts))
        for cell, chart in zip(grid, charts, strict=True):
            chart.draw_into(cell)
        figure.suptitle(
            printable(_title(calibration)), fontsize=9, y=1 - 0.12 / _HEIGHT_IN, va="top", parse_math=False
        )
        _label(figure, calibration)
        return save(figure, path)


def _row(charts: int) -> tuple[Any, Any]:
    """Return a figure and a grid with one row of cells in it."""
    margin = _MARGIN_IN
    width_in = margin["left"] + charts * _CHART_IN + (charts - 1) * margin["between"] + margin["right"]
    figure = new_figure(width_in, _HEIGHT_IN, layout=None)
    figure.subplots_adjust(
        left=margin["left"] / width_in,
        right=1 - margin["right"] / width_in,
        top=1 - margin["top"] / _HEIGHT_IN,
        bottom=margin["bottom"] / _HEIGHT_IN,
        wspace=margin["between"] / _CHART_IN,
    )
    return figure, figure.add_gridspec(1, charts)


def _label(figure: Any, calibration: Calibration) -> None:
    """Say under a picture that its curves are known only up to an exponent, where that is so."""
    if calibration.exponent_sigma:
        figure.supxlabel(
            "The exposures were unknown: response, vignette and exposures are estimated up to one common exponent γ "
            f"(ln γ ± {calibration.exponent_sigma:.2f})",
            fontsize=8,
            color=ORANGE,
        )


def _title(calibration: Calibration) -> str:
    counts = calibration.counts
    parts = [str(calibration.source.get("name", "")), f"{calibration.size[0]}×{calibration.size[1]} pixels"]
    if "frames" in counts:
        parts.append(f"{counts['frames']} frames")
    if calibration.partial:
        parts.append("partial: the run stopped before the end")
    return " · ".join(part for part in parts if part)
