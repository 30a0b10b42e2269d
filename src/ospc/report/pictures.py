"""The PNG pictures of a calibration, and a picture that compares several calibrations."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ospc.arrays import Image
from ospc.errors import counted
from ospc.formats.image_files import encoded
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.vignette import diagonal_profile
from ospc.report.charts import ReportFindings
from ospc.report.curves import RADIUS_LABEL
from ospc.report.style import BLACK, BLUE, GREEN, ORANGE, as_image, new_figure, printable, rules, save

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry

_CONTENT = {
    "figure.png": ("response", "vignette", "ratios"),
    "plot_response.png": ("response",),
    "plot_vignette.png": ("vignette", "vignette map"),
    "plot_exposures.png": ("exposures", "ratios"),
}

PICTURES = tuple(_CONTENT)
"""File names: an overview like figure 3 of the paper, and its three parts separately."""

_HEIGHT_IN, _CHART_IN = 4.2, 3.05
_MARGINS_IN = {"left": 0.86, "right": 0.14, "top": 0.62, "bottom": 0.72}
"""Margins around the charts for titles and labels."""

_TILE_IN = _MARGINS_IN["left"] + _CHART_IN + _MARGINS_IN["right"]
"""Width of a chart with its margins: a whole number of pixels, so that drawings can be joined."""

_LINE_IN = 0.14
"""Height of a line below the charts."""

_LETTERS = 58
"""Letters per line that fit into the width of a chart."""

_STYLES = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (BLACK, ":"))
"""Colours and line styles of successive calibrations, distinguishable even if curves coincide."""

_NAME_LETTERS = 40
"""Most letters of a name in a legend, so that the curves keep enough room. Longer names are cut at the beginning,
because their end is more informative."""


def pictures_of(findings: ReportFindings) -> dict[str, Image]:
    """Return those of :data:`PICTURES` with known content, by name, shape (height, width, 3) in BGR.

    Each chart is drawn only once, even if several pictures show it, because drawing takes most of the time.
    """
    calibration, charts = findings.calibration, findings.charts
    content = {name: [part for part in parts if part in charts] for name, parts in _CONTENT.items()}
    caveat_in = _LINE_IN * len(_caveat(calibration))
    height_in, margins_in = _HEIGHT_IN + caveat_in, _MARGINS_IN | {"bottom": _MARGINS_IN["bottom"] + caveat_in}
    with rules():
        tiles = {
            part: as_image(charts[part].drawn(_TILE_IN, height_in, margins_in))
            for part in dict.fromkeys(part for parts in content.values() for part in parts)
        }
        words = as_image(words_around(calibration, max(map(len, content.values())) * _TILE_IN, height_in))
    pictures = {}
    for name, parts in content.items():
        if name == PICTURES[0] or not all(charts[part].unknown for part in parts):
            picture = np.concatenate([tiles[part] for part in parts], axis=1)
            pictures[name] = np.minimum(picture, words[:, : picture.shape[1]])
    return pictures


def pictures_as_png(findings: ReportFindings) -> dict[str, bytes]:
    """Return the same pictures as PNG data."""
    return {name: encoded(picture, ".png", name) for name, picture in pictures_of(findings).items()}


def words_around(calibration: Calibration, width_in: float, height_in: float) -> Any:
    """Return a figure of the text around charts: the title of a picture above and its caveat below."""
    figure = new_figure(width_in, height_in, _MARGINS_IN)
    at, edge = 0.12 / width_in, 0.06 / height_in
    title = textwrap.fill(_title(calibration), _LETTERS, max_lines=2)
    figure.text(at, 1 - edge, printable(title), fontsize=8.5, va="top", parse_math=False, linespacing=1.1)
    caveat = "\n".join(_caveat(calibration))
    figure.text(at, edge, caveat, fontsize=8, va="bottom", color=ORANGE, linespacing=1.1)
    return figure


def _caveat(calibration: Calibration) -> list[str]:
    """Return the lines below the charts; none if the calibration is based on known exposures."""
    return textwrap.wrap(calibration.caveat, _LETTERS)


def _title(calibration: Calibration) -> str:
    counts = calibration.counts
    parts = [str(calibration.source.get("name", "")), f"{calibration.size[0]}×{calibration.size[1]} pixels"]
    if "frames" in counts:
        parts.append(counted(counts["frames"], "frame"))
    if calibration.partial:
        parts.append("partial: the run stopped before the end")
    return " · ".join(part for part in parts if part)


def plot_photometries(photometries: Sequence[Photometry], path: str | Path) -> Path:
    """Draw inverse responses and radial profiles of vignettes, and return the path of the picture."""
    with rules():
        figure = new_figure(9.6, 4.4)
        left, right = figure.subplots(1, 2)
        _draw_responses(left, photometries)
        _draw_vignettes(right, photometries)
        for axes in (left, right):
            for text in axes.legend().get_texts():
                text.set_parse_math(False)
        return save(figure, Path(path))


def _draw_responses(axes: Any, photometries: Sequence[Photometry]) -> None:
    """Draw responses, scaled to agree with the first where its uncertainty is 0: their scale is not observable."""
    first = next((photometry.response for photometry in photometries if photometry.response is not None), None)
    top, title = 1.0, "Inverse response"
    for photometry, (colour, line) in zip(photometries, cycle(_STYLES), strict=False):
        response, label = photometry.response, _label(photometry)
        if response is None or first is None:
            axes.plot([], [], line, color=colour, label=f"{label}: no response")
            continue
        scale = response.scale_to(first)
        grey, g, sigma = 255 * response.levels, scale * response.inverse_table, response.log_sigma
        axes.plot(grey, g, line, color=colour, label=label)
        if sigma is not None:
            axes.fill_between(grey, g * (1 - 2 * sigma), g * (1 + 2 * sigma), color=colour, alpha=0.2, lw=0)
        top = max(top, scale)
    if first is not None:
        title += f" with ±2σ, equal at grey level {255 * first.reference_grey:.0f}"
    axes.set(title=title, xlabel="grey level, of 255", ylabel="irradiance g(M)", xlim=(0, 255), ylim=(0, 1.02 * top))


def _draw_vignettes(axes: Any, photometries: Sequence[Photometry]) -> None:
    for photometry, (colour, line) in zip(photometries, cycle(_STYLES), strict=False):
        vignette, label = photometry.vignette, _label(photometry)
        if vignette is None:
            axes.plot([], [], line, color=colour, label=f"{label}: no vignette")
        else:
            axes.plot(PROFILE_RADII, diagonal_profile(vignette, PROFILE_RADII), line, color=colour, label=label)
    axes.set(title="Vignette", xlabel=RADIUS_LABEL, ylabel="attenuation V", xlim=(0, 1))
    if all(photometry.vignette is None for photometry in photometries):
        axes.set(ylim=(0, 1.02))


def _label(photometry: Photometry) -> str:
    name = printable(photometry.name)
    # The space: matplotlib leaves labels with a leading underscore out of the legend.
    return f" {name}" if len(name) <= _NAME_LETTERS else f" …{name[-_NAME_LETTERS:]}"
