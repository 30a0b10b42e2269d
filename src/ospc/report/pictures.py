"""The drawings of a calibration, and a picture that compares several calibrations."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.vignette import diagonal_profile
from ospc.report.charts import ReportFindings, charts_as_svg
from ospc.report.curves import RADIUS_LABEL
from ospc.report.style import BLACK, BLUE, GREEN, ORANGE, as_bytes, new_figure, printable, rules, save
from ospc.report.words import basis_of, name_of

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry

PICTURE = "figure.png"
"""File name of the picture of a calibration: an overview like figure 3 of the paper."""
_HEIGHT_IN, _CHART_IN = 4.2, 3.05
_MARGINS_IN = {"left": 0.86, "right": 0.14, "top": 0.62, "bottom": 0.72}
"""Margins around the charts for titles and labels."""
_LINE_IN = 0.14
"""Height of a line below the charts."""
_LETTERS = 58
"""Letters per line that fit into the width of a chart."""
_STYLES = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (BLACK, ":"))
"""Colours and line styles of successive calibrations, distinguishable even if curves coincide."""
_NAME_LETTERS = 40
"""Most letters of a name in a legend, so that the curves keep enough room. Longer names are cut at the beginning,
because their end is more informative."""


class Drawings(NamedTuple):
    """The charts of a report as :func:`charts_as_svg` returns them, and the picture as PNG data."""

    charts: dict[str, str]
    picture: bytes


def drawings_of(findings: ReportFindings) -> Drawings:
    """Draw all charts and the picture."""
    return Drawings(charts_as_svg(findings), picture_as_png(findings))


def picture_as_png(findings: ReportFindings) -> bytes:
    """Draw the picture of a calibration, and return it as PNG data."""
    with rules():
        return as_bytes(figure_of(findings), "png")


def figure_of(findings: ReportFindings) -> Any:
    """Return a figure of response, vignette and known exposure ratios, with a title above and the caveat below."""
    charts = [findings.charts[name] for name in ("response", "vignette", "ratios") if name in findings.charts]
    caveat = textwrap.wrap(printable(findings.calibration.caveat), _LETTERS)
    between_in, below_in = _MARGINS_IN["left"] + _MARGINS_IN["right"], _LINE_IN * len(caveat)
    width_in, height_in = (between_in + _CHART_IN) * len(charts), _HEIGHT_IN + below_in
    margins_in = _MARGINS_IN | {"bottom": _MARGINS_IN["bottom"] + below_in}
    figure = new_figure(width_in, height_in, margins_in)
    for cell, chart in zip(figure.add_gridspec(1, len(charts), wspace=between_in / _CHART_IN), charts, strict=True):
        chart.draw_into(cell)
    at, edge = 0.12 / width_in, 0.06 / height_in
    title = f"{name_of(findings.calibration)} · {basis_of(findings.calibration)}"
    title = textwrap.fill(printable(title), _LETTERS, max_lines=2)
    below = "\n".join(caveat)
    figure.text(at, 1 - edge, title, fontsize=8.5, va="top", parse_math=False, linespacing=1.1)
    figure.text(at, edge, below, fontsize=8, va="bottom", color=ORANGE, parse_math=False, linespacing=1.1)
    return figure


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
