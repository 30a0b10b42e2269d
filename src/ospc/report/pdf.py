"""The report for papers and archives: the same content on A4 pages, curves as vectors."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ospc.atomic import write_atomically
from ospc.errors import FormatError
from ospc.report import evidence_panels as evidence
from ospc.report.page import Findings, details, gaps, name_of, seen, shown, tracking_rows
from ospc.report.panels import (
    draw_exposures,
    draw_response,
    draw_response_error,
    draw_vignette,
    draw_vignette_error,
    draw_vignette_map,
)
from ospc.report.style import new_figure, rules
from ospc.report.words import facts, headline

_A4_IN = (8.27, 11.69)
_LEFT, _TOP, _BOTTOM = 0.09, 0.945, 0.05
_LINE, _COLUMNS = 0.0155, 96


def write_pdf(findings: Findings, path: Path) -> Path:
    """Write the report as PDF, whole or not at all, and return its path.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    FormatError
        If it cannot be written.
    """
    new_figure(1, 1)  # says which extra is missing before anything else does
    from matplotlib.backends.backend_pdf import PdfPages

    content = io.BytesIO()
    title = f"Photometric calibration of {name_of(findings.calibration)}"
    # No date: a report is of its calibration, which says what it was made from.
    facts_of_file = {"Title": title, "Creator": "ospc", "CreationDate": None}
    with rules(), PdfPages(content, metadata=facts_of_file) as pages:
        for figure in _pages(findings, title):
            pages.savefig(figure)
    try:
        return write_atomically(path, content.getvalue())
    except OSError as error:
        raise FormatError(f"{path}: the report cannot be written ({error.strerror})") from None


def _pages(findings: Findings, title: str) -> Iterator[Any]:
    yield _first_page(findings, title)
    yield _exposure_page(findings)
    if findings.calibration.coverage is not None:
        yield _coverage_page(findings)
    if findings.examples.pictures:
        yield _picture_page(findings)
    yield from _text_pages(findings)


def _first_page(findings: Findings, title: str) -> Any:
    calibration, truth = findings.calibration, findings.truth
    figure = new_figure(*_A4_IN)
    said = [f"• {fact}" for fact in facts(calibration)]
    if findings.examples.tracking is not None:
        said.append(f"• {findings.examples.tracking.sentence}")
    for name, verdict in calibration.verdicts.items():
        said += ["", f"{name}: {verdict.state}; {verdict.reason}"]
        said += [f"→ {verdict.remedy}"] if verdict.remedy else []
    figure.text(_LEFT, _TOP, title, fontsize=15, weight="bold")
    figure.text(_LEFT, _TOP - 0.02, seen(calibration), fontsize=9, color="0.35")
    top = _write(figure, [headline(calibration)], _TOP - 0.05, weight="bold", size=11)
    top = _write(figure, said, top - 0.008)
    figure.set_layout_engine("constrained", rect=(0.03, 0.3 * (top - 0.1), 0.94, top - 0.02 - 0.3 * (top - 0.1)))
    grid = figure.add_gridspec(2, 2, height_ratios=(3, 1))
    response, vignette = (None, None) if truth is None else (truth.response, truth.vignette)
    draw_response(figure.add_subplot(grid[0, 0]), calibration, response)
    draw_response_error(figure.add_subplot(grid[1, 0]), calibration, response)
    draw_vignette(figure.add_subplot(grid[0, 1]), calibration, vignette)
    draw_vignette_error(figure.add_subplot(grid[1, 1]), calibration, vignette)
    return figure


def _exposure_page(findings: Findings) -> Any:
    calibration = findings.calibration
    figure = _page()
    upper, middle, lower = figure.subplots(3, 1)
    ratios = calibration.exposure_ratios
    if (
        findings.exposures_ms is not None
        and ratios.metadata.size
        and len(findings.exposures_ms) > ratios.frames.max()
    ):
        evidence.draw_exposures_stated(upper, findings.exposures_ms, ratios)
    else:
        upper.remove()
    draw_exposures(middle, calibration)
    if calibration.vignette is not None:
        draw_vignette_map(lower, calibration.vignette)
    else:
        lower.remove()
    return figure


def _coverage_page(findings: Findings) -> Any:
    coverage, max_grey = findings.calibration.coverage, findings.calibration.max_grey
    assert coverage is not None
    figure = _page()
    axes = figure.subplots(3, 2)
    evidence.draw_grey_coverage(axes[0, 0], coverage, max_grey)
    evidence.draw_radius_coverage(axes[0, 1], coverage)
    drawn = 2
    if coverage.residual_by_grey is not None:
        evidence.draw_grey_residual(axes[1, 0], coverage.residual_by_grey, max_grey)
        drawn += 1
    if coverage.residual_by_radius is not None:
        evidence.draw_radius_residual(axes[1, 1], coverage.residual_by_radius)
        drawn += 1
    if coverage.residual_by_place is not None and np.isfinite(coverage.residual_by_place).any():
        evidence.draw_place_residual(axes[2, 0], coverage.residual_by_place)
        drawn += 1
    for unused in axes.ravel()[drawn:]:
        unused.remove()
    return figure


def _picture_page(findings: Findings) -> Any:
    pairs = findings.examples.pictures
    figure = _page()
    rows = figure.subplots(2 * len(pairs), 2, squeeze=False)
    for number, pair in enumerate(pairs):
        evidence.draw_picture_pair(rows[2 * number : 2 * number + 2], pair)
    return figure


def _text_pages(findings: Findings) -> Iterator[Any]:
    lines = _text(findings)
    room = int((_TOP - _BOTTOM) / _LINE)
    wrapped = [part for line in lines for part in _wrapped(line)]
    for start in range(0, len(wrapped), room):
        figure = _page()
        _write(figure, wrapped[start : start + room], _TOP)
        yield figure


def _text(findings: Findings) -> list[str]:
    calibration = findings.calibration
    lines: list[str] = []
    tracking = findings.examples.tracking
    if tracking is not None:
        lines += ["TRACKING POINTS, AS RECORDED → CORRECTED"]
        lines += [f"{label}: {before} → {after} {unit}" for label, before, after, unit in tracking_rows(tracking)]
        lines += [""]
    improvements = [*calibration.advice, *gaps(calibration.coverage, calibration.max_grey)]
    lines += ["WHAT WOULD IMPROVE IT", *(improvements or ["nothing that this recording shows"]), ""]
    if findings.check is not None:
        lines += ["CHECK OF THE RECORDING"]
        lines += [f"{name}: {v['state']}; {v['reason']}" for name, v in findings.check["verdicts"].items()]
        lines += [*map(str, findings.check["notes"]), ""]
    for heading, content in details(calibration).items():
        if content:
            lines += [heading.upper(), *(f"{name}: {shown(value)}" for name, value in content.items()), ""]
    return lines


def _page() -> Any:
    figure = new_figure(*_A4_IN)
    figure.set_layout_engine("constrained", rect=(0.04, 0.03, 0.92, 0.94))
    return figure


def _wrapped(line: str) -> list[str]:
    return textwrap.wrap(line, _COLUMNS, subsequent_indent="   ") or [""]


def _write(figure: Any, lines: list[str], top: float, *, size: float = 9.5, weight: str = "normal") -> float:
    """Write lines below one another, wrapped, and return where the next would be."""
    for text in (part for line in lines for part in _wrapped(line)):
        figure.text(_LEFT, top, text, fontsize=size, weight=weight)
        top -= _LINE
    return top
