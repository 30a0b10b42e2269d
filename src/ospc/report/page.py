"""The report as one HTML page: a self-contained file that needs neither network nor scripts."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from ospc.formats.files import write_bytes
from ospc.formats.image_files import encoded
from ospc.photometry.verdict import Verdict
from ospc.report.charts import Chart, ReportFindings, charts_as_svg
from ospc.report.examples import NOTHING_TRIED, Examples, Pictures
from ospc.report.html import Html, document, join, tag
from ospc.report.sections import SUMMARY, Section, basis_of, name_of, overall_state, sections_of, shown

_JPEG_QUALITY = 85
_STATE_CLASSES = {"identifiable": "good", "marginal": "fair", "not identifiable": "bad"}


def write_page(
    findings: ReportFindings, path: Path, examples: Examples = NOTHING_TRIED, charts: Mapping[str, str] | None = None
) -> Path:
    """Write the report completely or not at all, and return its path; ``charts`` are charts already drawn."""
    # A file name or a JSON text may contain half a surrogate pair, which UTF-8 cannot encode.
    return write_bytes(path, page(findings, examples, charts).encode("utf-8", "replace"))


def page(
    findings: ReportFindings, examples: Examples = NOTHING_TRIED, charts: Mapping[str, str] | None = None
) -> str:
    """Return the report as HTML; the arguments are those of :func:`write_page`."""
    drawn = charts_as_svg(findings) if charts is None else charts
    calibration = findings.calibration
    title = f"Photometric calibration of {name_of(calibration)}"
    summary_class = f"verdict {_STATE_CLASSES.get(overall_state(calibration), '')}"
    return document(
        title,
        files("ospc.report").joinpath("report.css").read_text(encoding="utf-8"),
        tag("header", tag("h1", title), tag("p", basis_of(calibration))),
        *(
            join(_section(section, drawn, summary_class if section.heading == SUMMARY else ""), "\n")
            for section in sections_of(findings, examples)
        ),
    )


def _section(section: Section, drawn: Mapping[str, str], class_: str) -> Html:
    first = "first" if section.heading == SUMMARY else ""
    return tag(
        "section",
        tag("h2", section.heading),
        *(tag("p", text, class_=first) for text in section.text),
        tag("ul", *(tag("li", item) for item in section.items)) if section.items else "",
        _parts(*(_verdict(name, verdict) for name, verdict in section.verdicts.items())),
        _parts(*(_chart(chart, drawn) for chart in section.charts)),
        *(_pictures(scene) for scene in section.pictures),
        _figures(section.figures),
        tag("p", section.remark, class_="soft") if section.remark else "",
        _parts(*(join(tag("h3", heading), _table(content)) for heading, content in section.tables.items())),
        class_=class_,
    )


def _parts(*parts: Html) -> Html:
    return tag("div", *(tag("div", part) for part in parts), class_="parts") if parts else Html()


def _verdict(name: str, verdict: Verdict) -> Html:
    state = tag("span", verdict.state, class_=f"state {_STATE_CLASSES.get(verdict.state, '')}")
    remedy = tag("p", verdict.remedy, class_="remedy") if verdict.remedy else ""
    return join(tag("h3", f"{name.capitalize()}: ", state), tag("p", verdict.reason), remedy)


def _chart(chart: Chart, drawn: Mapping[str, str]) -> Html:
    if chart.unknown:
        return join(tag("h3", chart.title), tag("p", chart.unknown, class_="soft"))
    return tag("figure", Html(drawn[chart.title]), tag("figcaption", chart.caption))


def _pictures(scene: Pictures) -> Html:
    figures = []
    for image, caption in scene:
        data = base64.b64encode(encoded(image, ".jpg", "picture", jpeg_quality=_JPEG_QUALITY)).decode("ascii")
        picture = tag("img", src=f"data:image/jpeg;base64,{data}", alt=caption)
        figures.append(tag("figure", picture, tag("figcaption", caption)))
    return tag("div", *figures, class_="pictures")


def _figures(rows: tuple[tuple[str, str, str, str], ...]) -> Html:
    if not rows:
        return Html()
    header = tag("tr", tag("th"), *(tag("th", name, class_="number") for name in ("as recorded", "corrected")))
    body = (
        tag(
            "tr",
            tag("td", label, *([tag("br"), tag("span", unit, class_="soft")] if unit else [])),
            tag("td", before, class_="number"),
            tag("td", after, class_="number"),
        )
        for label, before, after, unit in rows
    )
    return tag("table", header, *body, class_="figures")


def _table(content: Mapping[str, Any]) -> Html:
    rows = [tag("tr", tag("td", str(name)), tag("td", tag("code", shown(v)))) for name, v in content.items()]
    return tag("table", *rows)
