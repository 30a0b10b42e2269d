"""The pictures of a calibration that are written as PNG files."""

from __future__ import annotations

import textwrap
from pathlib import Path

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

_HEIGHT_IN, _CHART_IN, _BETWEEN_IN = 4.2, 3.1, 0.85
_LETTERS_PER_IN = 16
"""Letters of the caveat below a picture in an inch."""

_MARGINS_IN = {"left": 0.78, "right": 0.15, "top": 0.62, "bottom": 0.72}
"""Room around the charts for titles and labels."""


def write_picture(name: str, findings: Findings, path: Path) -> Path | None:
    """Draw one of :data:`PICTURES` and return its path, or None where what it shows is unknown.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    available, calibration = charts_of(findings), findings.calibration
    charts = [available[part] for part in _CONTENT[name] if part in available]
    if name != PICTURES[0] and all(chart.unknown for chart in charts):
        return None
    width_in = len(charts) * (_CHART_IN + _BETWEEN_IN) - _BETWEEN_IN + _MARGINS_IN["left"] + _MARGINS_IN["right"]
    with rules():
        figure = new_figure(width_in, _HEIGHT_IN, _MARGINS_IN)
        for cell, chart in zip(
            figure.add_gridspec(1, len(charts), wspace=_BETWEEN_IN / _CHART_IN), charts, strict=True
        ):
            chart.draw_into(cell)
        figure.suptitle(
            printable(_title(calibration)), fontsize=9, y=1 - 0.12 / _HEIGHT_IN, va="top", parse_math=False
        )
        caveat = textwrap.fill(calibration.rests_on, round(_LETTERS_PER_IN * width_in)) or calibration.caveat
        figure.supxlabel(caveat, fontsize=8, color=ORANGE)
        return save(figure, path)


def _title(calibration: Calibration) -> str:
    counts = calibration.counts
    parts = [str(calibration.source.get("name", "")), f"{calibration.size[0]}×{calibration.size[1]} pixels"]
    if "frames" in counts:
        parts.append(f"{counts['frames']} frames")
    if calibration.partial:
        parts.append("partial: the run stopped before the end")
    return " · ".join(part for part in parts if part)
