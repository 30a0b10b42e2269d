"""The report as one HTML page: a self-contained file that needs neither network nor scripts."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ospc.errors import counted
from ospc.evaluation.tracking import TrackingComparison
from ospc.formats.image_files import encoded
from ospc.photometry.verdict import Verdict
from ospc.report.charts import Chart, ReportFindings, charts_as_svg
from ospc.report.examples import NOTHING_TRIED, Examples, Pictures
from ospc.report.html import Html, document, join, tag
from ospc.report.words import basis_of, facts, headline, name_of, overall_state, sentence, shown, tracking_rows

_JPEG_QUALITY = 85
_ABOUT_PICTURES = (
    "Frames of this recording as recorded, and as the camera would have recorded them without vignette and at the "
    "longer exposure of the two. With a good calibration, the corrected frames look the same."
)
_STATE_CLASSES = {"identifiable": "good", "marginal": "fair", "not identifiable": "bad"}


def page(
    findings: ReportFindings, examples: Examples = NOTHING_TRIED, charts: Mapping[str, str] | None = None
) -> str:
    """Return the report as HTML; by default, its charts are drawn now."""
    drawn = charts_as_svg(findings) if charts is None else charts
    title = f"Photometric calibration of {name_of(findings.calibration)}"
    return document(
        title,
        tag("header", tag("h1", title), tag("p", basis_of(findings.calibration))),
        *(join(section, "\n") for section in _sections(findings, examples, drawn)),
    )


def _sections(findings: ReportFindings, examples: Examples, drawn: Mapping[str, str]) -> Iterator[Html]:
    """Yield the sections in the order of a report, without empty ones."""
    calibration, charts = findings.calibration, findings.charts

    def drawings(*names: str) -> Html:
        return _parts(*(_chart(charts[name], drawn) for name in names if name in charts))

    yield _section(
        "Summary",
        tag("p", headline(calibration), class_="first"),
        _list(facts(calibration, examples.tracking)),
        _parts(*(_verdict(name, verdict) for name, verdict in calibration.verdicts.items())),
        class_=f"verdict {_STATE_CLASSES.get(overall_state(calibration), '')}",
    )
    reference: str = Html()
    if findings.truth is not None:
        name = findings.truth.name
        reference = tag("p", f"The reference is {name}; only the scale of its response is adapted.")
    yield _section("Response and vignette", reference, drawings("response", "vignette", "vignette map"))
    compared = drawings("exposures", "ratios")
    yield _section("Exposures", compared or tag("p", "No pairs of frames could be compared."))
    if examples.pictures or examples.notes:
        about = tag("p", _ABOUT_PICTURES) if examples.pictures else ""
        yield _section(
            "Before and after", about, _list(map(sentence, examples.notes)), *map(_scene, examples.pictures)
        )
    if examples.tracking is not None:
        yield _tracking(examples.tracking, *examples.tracked)
    if coverage := drawings("grey coverage", "radius coverage"):
        yield _section("Coverage", coverage)
    if residuals := drawings("grey residual", "radius residual", "place residual"):
        yield _section("Residuals", residuals)
    improvements = _list(sentence(advice) for advice in calibration.advice if advice)
    yield _section("How to improve it", improvements or tag("p", "There is nothing to improve."))
    tables: dict[str, Mapping[str, Any]] = {
        "Settings": calibration.settings,
        "Recording": calibration.source,
        "Noise of a grey level": {} if calibration.noise is None else vars(calibration.noise),
        "Versions": calibration.versions,
    }
    parts = (join(tag("h3", heading), _table(table)) for heading, table in tables.items() if table)
    yield _section("Settings and versions", _parts(*parts))


def _section(heading: str, *content: str, class_: str = "") -> Html:
    return tag("section", tag("h2", heading), *content, class_=class_)


def _list(items: Iterable[str]) -> Html:
    listed = [tag("li", item) for item in items]
    return tag("ul", *listed) if listed else Html()


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


def _scene(scene: Pictures) -> Html:
    figures = []
    for image, caption in scene:
        data = base64.b64encode(encoded(image, ".jpg", "picture", jpeg_quality=_JPEG_QUALITY)).decode("ascii")
        picture = tag("img", src=f"data:image/jpeg;base64,{data}", alt=caption)
        figures.append(tag("figure", picture, tag("figcaption", caption)))
    return tag("div", *figures, class_="pictures")


def _tracking(tracking: TrackingComparison, first: int, end: int) -> Html:
    header = tag("tr", tag("th"), *(tag("th", name, class_="number") for name in ("as recorded", "corrected")))
    body = (
        tag(
            "tr",
            tag("td", label, *([tag("br"), tag("span", unit, class_="soft")] if unit else [])),
            tag("td", before, class_="number"),
            tag("td", after, class_="number"),
        )
        for label, before, after, unit in tracking_rows(tracking)
    )
    remark = (
        f"{counted(tracking.tracks, 'point')}, tracked through frames {first} to {end - 1} by the same method with "
        f"the same settings; the exposure changes by up to {tracking.largest_step:.3g}:1 from frame to frame. "
        "'ospc evaluate tracking' evaluates a whole recording."
    )
    figures = tag("table", header, *body, class_="figures")
    return _section("Effect on tracking", tag("p", tracking.sentence), figures, tag("p", remark, class_="soft"))


def _table(content: Mapping[str, Any]) -> Html:
    rows = [tag("tr", tag("td", str(name)), tag("td", tag("code", shown(v)))) for name, v in content.items()]
    return tag("table", *rows)
