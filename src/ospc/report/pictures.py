"""The pictures of a calibration that are written as PNG files."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ospc.arrays import Image
from ospc.photometry.calibration import Calibration
from ospc.report.charts import Chart, Findings, charts_of
from ospc.report.style import DPI, ORANGE, as_image, new_figure, printable, rules

_CONTENT = {
    "figure.png": ("response", "vignette", "ratios"),
    "plot_response.png": ("response",),
    "plot_vignette.png": ("vignette", "vignette map"),
    "plot_exposures.png": ("exposures", "ratios"),
}

PICTURES = tuple(_CONTENT)
"""File names: an overview like figure 3 of the paper, and its three parts on their own."""

_HEIGHT_IN, _CHART_IN = 4.2, 3.05
_MARGINS_IN = {"left": 0.76, "right": 0.14, "top": 0.62, "bottom": 0.72}
"""Room around the charts for titles and labels."""

_TILE_IN = _MARGINS_IN["left"] + _CHART_IN + _MARGINS_IN["right"]
"""Width of a chart with its margins: a whole number of pixels, so that pictures can be cut from one drawing."""

_HEAD_IN, _FOOT_IN = 0.3, 0.2
"""Height of the lines above and below the charts that belong to the whole picture."""


def pictures_of(findings: Findings) -> dict[str, Image]:
    """Return those of :data:`PICTURES` that show something known, by name, shape (height, width, 3) in BGR.

    Every chart is drawn only once, though several pictures may show it: drawing takes most of the time.
    """
    charts = charts_of(findings)
    content = {name: [part for part in parts if part in charts] for name, parts in _CONTENT.items()}
    row = list(dict.fromkeys(part for parts in content.values() for part in parts))
    with rules():
        whole = as_image(row_of((charts[part] for part in row), findings.calibration))
    tiles = dict(zip(row, np.split(whole, len(row), axis=1), strict=True))
    pictures = {}
    for name, parts in content.items():
        if name == PICTURES[0] or not all(charts[part].unknown for part in parts):
            picture = np.concatenate([tiles[part] for part in parts], axis=1)
            for lines in (slice(round(_HEAD_IN * DPI)), slice(-round(_FOOT_IN * DPI), None)):
                picture[lines] = whole[lines, : picture.shape[1]]
            pictures[name] = picture
    return pictures


def row_of(charts: Iterable[Chart], calibration: Calibration) -> Any:
    """Return a figure of charts side by side, with the title of a picture above and its caveat below, both left."""
    charts = list(charts)
    width_in = len(charts) * _TILE_IN
    figure = new_figure(width_in, _HEIGHT_IN, _MARGINS_IN)
    between = (_MARGINS_IN["left"] + _MARGINS_IN["right"]) / _CHART_IN
    for cell, chart in zip(figure.add_gridspec(1, len(charts), wspace=between), charts, strict=True):
        chart.draw_into(cell)
    at, edge = 0.12 / width_in, 0.12 / _HEIGHT_IN
    figure.text(at, 1 - edge, printable(_title(calibration)), fontsize=9, va="top", parse_math=False)
    figure.text(at, edge / 2, calibration.caveat, fontsize=8, va="bottom", color=ORANGE)
    return figure


def _title(calibration: Calibration) -> str:
    counts = calibration.counts
    parts = [str(calibration.source.get("name", "")), f"{calibration.size[0]}×{calibration.size[1]} pixels"]
    if "frames" in counts:
        parts.append(f"{counts['frames']} frames")
    if calibration.partial:
        parts.append("partial: the run stopped before the end")
    return " · ".join(part for part in parts if part)
