"""The report as one HTML page: a self-contained file that needs neither network nor scripts."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2

from ospc.arrays import Image
from ospc.formats.files import write_bytes
from ospc.photometry.calibration import Calibration, Verdict
from ospc.report.charts import WIDTH_IN, Chart, Findings, charts_of
from ospc.report.examples import Examples, PicturePair
from ospc.report.html import Html, document, join, tag
from ospc.report.style import as_svg, new_figure, rules
from ospc.report.tables import basis_of, name_of, sentence, settings_of, shown, tracking_rows
from ospc.report.words import facts, gaps, headline, overall_state

_JPEG_QUALITY = 85
_STATE_CLASSES = {"identifiable": "good", "marginal": "fair", "not identifiable": "bad"}
_MARGINS_IN = {"left": 0.78, "right": 0.12, "top": 0.28, "bottom": 0.48}
"""Room around the axes of a chart for its title and labels."""


def write_page(findings: Findings, path: Path) -> Path:
    """Write the report, whole or not at all, and return its path.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    # A file name or a JSON text may hold half a surrogate pair, which UTF-8 cannot express.
    return write_bytes(path, page(findings).encode("utf-8", "replace"))


def page(findings: Findings) -> str:
    """Return the report as HTML."""
    calibration, charts = findings.calibration, charts_of(findings)
    title = f"Photometric calibration of {name_of(calibration)}"
    return document(
        title,
        files("ospc.report").joinpath("report.css").read_text(encoding="utf-8"),
        tag("header", tag("h1", title), tag("p", basis_of(calibration))),
        _summary(findings),
        _curves(findings, charts),
        _exposures(charts),
        _pictures(findings.examples),
        _tracking(findings.examples),
        _charts("Coverage", charts, "grey coverage", "radius coverage"),
        _charts("Residuals", charts, "grey residual", "radius residual", "place residual"),
        _improvements(calibration),
        _check(findings.check),
        _settings(calibration),
    )


def _section(heading: str, *content: str, class_: str = "") -> Html:
    return join(tag("section", tag("h2", heading), *content, class_=class_), "\n")


def _list(items: list[str]) -> Html:
    return tag("ul", *(tag("li", item) for item in items)) if items else Html()


def _parts(*parts: Html) -> Html:
    return tag("div", *(tag("div", part) for part in parts), class_="parts")


def _drawn(chart: Chart) -> Html:
    left, right, top, bottom = (_MARGINS_IN[side] for side in ("left", "right", "top", "bottom"))
    with rules():
        figure = new_figure(WIDTH_IN, chart.height_in, layout=None)
        figure.subplots_adjust(
            left=left / WIDTH_IN,
            right=1 - right / WIDTH_IN,
            top=1 - top / chart.height_in,
            bottom=bottom / chart.height_in,
        )
        chart.draw_into(figure.add_gridspec(1, 1)[0])
        drawing = Html(as_svg(figure, chart.title))
    return tag("figure", drawing, tag("figcaption", chart.caption))


def _charts(heading: str, charts: Mapping[str, Chart], *names: str) -> Html:
    """Return a section with those of the named charts that exist; nothing where none does."""
    drawn = [_drawn(charts[name]) for name in names if name in charts]
    return _section(heading, _parts(*drawn)) if drawn else Html()


def _summary(findings: Findings) -> Html:
    calibration = findings.calibration
    return _section(
        "Summary",
        tag("p", headline(calibration), class_="first"),
        _list(facts(calibration, findings.examples.tracking)),
        _verdicts(calibration.verdicts),
        class_=f"verdict {_STATE_CLASSES.get(overall_state(calibration), '')}",
    )


def _verdicts(verdicts: Mapping[str, Verdict]) -> Html:
    return _parts(
        *(
            join(
                tag("h3", f"{name.capitalize()}: ", _state(verdict.state)),
                tag("p", verdict.reason),
                tag("p", verdict.remedy, class_="remedy") if verdict.remedy else "",
            )
            for name, verdict in verdicts.items()
        )
    )


def _state(state: str) -> Html:
    return tag("span", state, class_=f"state {_STATE_CLASSES.get(state, '')}")


def _curves(findings: Findings, charts: Mapping[str, Chart]) -> Html:
    calibration, truth = findings.calibration, findings.truth
    parts = [
        _unknown(calibration, name) if known is None else _drawn(charts[name])
        for name, known in (("response", calibration.response), ("vignette", calibration.vignette))
    ]
    if "vignette map" in charts:
        parts.append(_drawn(charts["vignette map"]))
    said = Html() if truth is None else tag("p", f"The reference is {truth.name}; nothing is aligned to it.")
    return _section("Response and vignette", said, _parts(*parts))


def _unknown(calibration: Calibration, part: str) -> Html:
    verdict = calibration.verdicts.get(part)
    reason = "" if verdict is None else f": {verdict.reason}"
    return join(tag("h3", part.capitalize()), tag("p", f"Not known{reason}.", class_="soft"))


def _exposures(charts: Mapping[str, Chart]) -> Html:
    return _charts("Exposures", charts, "exposures", "ratios") or _section(
        "Exposures", tag("p", "No pairs of frames could be compared.", class_="soft")
    )


def _pictures(examples: Examples) -> Html:
    notes = _list([sentence(note) for note in examples.notes])
    if not examples.pictures:
        return _section("Before and after", notes) if notes else Html()
    said = tag(
        "p",
        "Frames of this recording as recorded, and as the camera would have recorded them without vignette and at "
        "the longer exposure of the two. The better the calibration, the more alike are the corrected frames.",
    )
    return _section("Before and after", said, *(_picture_pair(pair) for pair in examples.pictures), notes)


def _picture_pair(pair: PicturePair) -> Html:
    figures = [
        tag("figure", tag("img", src=_as_jpeg(image), alt=caption), tag("figcaption", caption))
        for image, caption in pair.pictures
    ]
    return tag("div", *figures, class_="pictures")


def _as_jpeg(image: Image) -> str:
    _done, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return f"data:image/jpeg;base64,{base64.b64encode(encoded.tobytes()).decode('ascii')}"


def _tracking(examples: Examples) -> Html:
    tracking = examples.tracking
    if tracking is None:
        return Html()
    header = tag("tr", tag("th"), tag("th", "as recorded", class_="number"), tag("th", "corrected", class_="number"))
    rows = [
        tag(
            "tr",
            tag("td", label, tag("br"), tag("span", unit, class_="soft")),
            tag("td", before, class_="number"),
            tag("td", after, class_="number"),
        )
        for label, before, after, unit in tracking_rows(tracking)
    ]
    return _section(
        "Effect on tracking",
        tag("p", tracking.sentence),
        tag("table", header, *rows, class_="figures"),
        tag(
            "p",
            f"{tracking.tracks} points, tracked through frames {examples.tracked[0]} to {examples.tracked[1] - 1} by "
            "the same method with the same settings; the exposure changes by up to "
            f"{tracking.largest_step:.3g}:1 from frame to frame. 'ospc evaluate tracking' does this for a whole "
            "recording.",
            class_="soft",
        ),
    )


def _improvements(calibration: Calibration) -> Html:
    items = [sentence(advice) for advice in calibration.advice if advice]
    items += gaps(calibration.coverage, calibration.max_grey)
    return _section("How to improve it", _list(items) or tag("p", "This recording shows nothing to improve."))


def _check(check: Mapping[str, Any] | None) -> Html:
    if check is None:
        return Html()
    verdicts = {
        str(name): Verdict(verdict["state"], str(verdict["reason"]), str(verdict["remedy"]))
        for name, verdict in check["verdicts"].items()
    }
    return _section("Check of the recording", _verdicts(verdicts), _list([str(note) for note in check["notes"]]))


def _settings(calibration: Calibration) -> Html:
    tables = [
        join(tag("h3", heading), _table(content)) for heading, content in settings_of(calibration).items() if content
    ]
    return _section("Settings and versions", _parts(*tables))


def _table(content: Mapping[str, Any]) -> Html:
    rows = [tag("tr", tag("td", str(name)), tag("td", tag("code", shown(v)))) for name, v in content.items()]
    return tag("table", *rows)
