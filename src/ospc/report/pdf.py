"""The report as a PDF on A4 pages, with the charts as vectors."""

from __future__ import annotations

import io
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ospc.formats.files import write_bytes
from ospc.photometry.calibration import Calibration
from ospc.report.charts import Chart, ReportFindings
from ospc.report.examples import NOTHING_TRIED, Examples
from ospc.report.sections import Section, basis_of, name_of, sections_of, shown
from ospc.report.style import new_figure, printable, rules

_A4_IN = (8.27, 11.69)
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.09, 0.95, 0.95, 0.05
"""Edges of the printed area, as fractions of the page."""

_MARGINS_IN = {
    "left": (_LEFT + 0.025) * _A4_IN[0],
    "right": (1 - _RIGHT) * _A4_IN[0],
    "top": (1 - _TOP + 0.02) * _A4_IN[1],
    "bottom": _BOTTOM * _A4_IN[1],
}
"""Margins around charts; their labels stay inside the printed area."""

_LINE_SPACING = 1.25
"""Distance between lines of text, in font sizes."""

_TEXT_POINTS, _HEADLINE_POINTS, _TITLE_POINTS = 9.0, 11.0, 15.0

_CHART_ROWS = 4
"""Rows of charts on a page, two charts in each."""

_BETWEEN = {"wspace": 0.35, "hspace": 0.42}
"""Space between charts for labels, as fractions of their size."""

_POINTS_PER_INCH = 72
_ROOM_POINTS = (_RIGHT - _LEFT) * _A4_IN[0] * _POINTS_PER_INCH
"""Width of a line of text."""


def write_pdf(findings: ReportFindings, path: Path, examples: Examples = NOTHING_TRIED) -> Path:
    """Write the report as PDF, completely or not at all, and return its path."""
    from matplotlib.backends.backend_pdf import PdfPages

    content = io.BytesIO()
    title = printable(f"Photometric calibration of {name_of(findings.calibration)}")
    # No date, so that the same calibration gives the same bytes.
    with rules(), PdfPages(content, metadata={"Title": title, "Creator": "ospc", "CreationDate": None}) as pdf:
        for figure in pages(findings, examples):
            pdf.savefig(figure)
    return write_bytes(path, content.getvalue())


def pages(findings: ReportFindings, examples: Examples = NOTHING_TRIED) -> Iterator[Any]:
    """Return the pages as matplotlib figures: the summary, all charts, all pictures, and the text."""
    summary, *sections = sections_of(findings, examples)
    charts = [chart for section in sections for chart in section.charts]
    pictures = [picture for section in sections for scene in section.pictures for picture in scene]
    yield _first_page(findings.calibration, summary, charts[:2])
    for start in range(2, len(charts), 2 * _CHART_ROWS):
        yield _chart_page(charts[start : start + 2 * _CHART_ROWS])
    if pictures:
        yield _picture_page(pictures)
    yield from _text_pages([line for section in sections for line in _lines(section)])


def _first_page(calibration: Calibration, summary: Section, curves: list[Chart]) -> Any:
    """Return the summary page with the charts of response and vignette, which always exist."""
    figure = _page()
    top = _write(figure, [f"Photometric calibration of {name_of(calibration)}"], _TOP, _TITLE_POINTS, "bold")
    top = _write(figure, [basis_of(calibration)], top)
    top = _write(figure, ["", *summary.text], top, _HEADLINE_POINTS, "bold")
    top = _write(figure, ["", *_content(replace(summary, text=()), between=[""])], top)
    grid = figure.add_gridspec(1, 2, top=top - 0.04, bottom=max(_BOTTOM + 0.03, top - 0.5), **_BETWEEN)
    for cell, chart in zip(grid, curves, strict=True):
        chart.draw_into(cell)
    return figure


def _chart_page(charts: list[Chart]) -> Any:
    figure = _page()
    grid = figure.add_gridspec(_CHART_ROWS, 2, **_BETWEEN)
    for number, chart in enumerate(charts):
        chart.draw_into(grid[number // 2, number % 2])
    return figure


def _picture_page(pictures: list[tuple[Any, str]]) -> Any:
    figure = _page()
    grid = figure.add_gridspec(_CHART_ROWS, 2, wspace=0.05, hspace=0.2)
    for (image, caption), cell in zip(pictures, grid, strict=False):
        axes = figure.add_subplot(cell)
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
        axes.set_title(caption, fontsize=_TEXT_POINTS)
        axes.set_axis_off()
    return figure


def _lines(section: Section) -> list[str]:
    """Return the text of a section under its heading, or nothing if it has no text."""
    content = _content(section)
    return [section.heading.upper(), *content, ""] if content else []


def _content(section: Section, between: Sequence[str] = ()) -> list[str]:
    lines = [*section.text, *(f"• {item}" for item in section.items)]
    for name, verdict in section.verdicts.items():
        lines += [*between, f"{name}: {verdict.state}; {verdict.reason}"]
        lines += [f"→ {verdict.remedy}"] if verdict.remedy else []
    lines += [f"{label}: {before} → {after} {unit}" for label, before, after, unit in section.figures]
    lines += [section.remark] if section.remark else []
    for heading, table in section.tables.items():
        lines += [heading, *(f"{name}: {shown(value)}" for name, value in table.items()), ""]
    return lines


def _text_pages(lines: list[str]) -> Iterator[Any]:
    wrapped = [part for line in lines for part in _wrapped(line, _TEXT_POINTS, "normal")]
    room = int((_TOP - _BOTTOM) / _line_height(_TEXT_POINTS))
    for start in range(0, len(wrapped), room):
        figure = _page()
        _write(figure, wrapped[start : start + room], _TOP)
        yield figure


def _page() -> Any:
    return new_figure(*_A4_IN, _MARGINS_IN)


def _write(figure: Any, lines: list[str], top: float, points: float = _TEXT_POINTS, weight: str = "normal") -> float:
    """Write lines below one another, wrapped to the page, and return the position of the next line."""
    for text in (part for line in lines for part in _wrapped(line, points, weight)):
        figure.text(_LEFT, top, text, fontsize=points, weight=weight, va="top", parse_math=False)
        top -= _line_height(points)
    return top


def _line_height(points: float) -> float:
    return _LINE_SPACING * points / _POINTS_PER_INCH / _A4_IN[1]


def _wrapped(text: str, points: float, weight: str) -> list[str]:
    """Return a text wrapped to the width of the page; words longer than a line are divided."""
    lines: list[str] = []
    for word in printable(text).split():
        longer = f"{lines[-1]} {word}" if lines else word
        if _width(longer, points, weight) <= _ROOM_POINTS:
            lines[-1:] = [longer]
        else:
            lines += _divided(word, points, weight)
    return lines or [""]


def _divided(word: str, points: float, weight: str) -> Iterator[str]:
    """Yield pieces of a word that fill a line, with at least one character each."""
    while word:
        lengths = range(1, len(word) + 1)
        fitting = bisect_right(lengths, _ROOM_POINTS, key=lambda length: _width(word[:length], points, weight))
        yield word[: max(1, fitting)]
        word = word[max(1, fitting) :]


def _width(text: str, points: float, weight: str) -> float:
    """Return the width of a text in points."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    width, _height, _depth = text_to_path.get_text_width_height_descent(
        text, FontProperties(size=points, weight=weight), ismath=False
    )
    return float(width)
