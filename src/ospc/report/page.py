"""The report as one page: a self-contained file that needs neither network nor scripts."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.atomic import write_atomically
from ospc.errors import FormatError
from ospc.evaluation.tracking import TrackingComparison
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import Calibration, Verdict
from ospc.photometry.coverage import Coverage
from ospc.report import evidence_charts as evidence
from ospc.report.curve_charts import data_uri, response_figure, vignette_figure, vignette_map
from ospc.report.examples import Examples, PicturePair
from ospc.report.words import facts, headline, overall_state, uncovered_greys, uncovered_radii

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_LONGEST_LIST = 24


@dataclass(frozen=True)
class Findings:
    """All that a report shows.

    Attributes
    ----------
    calibration
        What was found.
    exposures_ms
        Exposure stated of every frame, shape (frames,); None where unknown.
    examples
        What the calibration does to its own recording.
    truth
        What to draw it against.
    check
        What a check of the recording said, as ``ospc check --json`` prints it; None where none was made.
    """

    calibration: Calibration
    exposures_ms: FloatArray | None = None
    examples: Examples = field(default_factory=Examples)
    truth: Photometry | None = None
    check: Mapping[str, Any] | None = None


def write_page(findings: Findings, path: Path) -> Path:
    """Write the report, whole or not at all, and return its path.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    try:
        return write_atomically(path, page(findings).encode("utf-8"))
    except OSError as error:
        raise FormatError(f"{path}: the report cannot be written ({error.strerror})") from None


def page(findings: Findings) -> str:
    """Return the report as HTML."""
    calibration = findings.calibration
    title = f"Photometric calibration of {name_of(calibration)}"
    style = files("ospc.report").joinpath("report.css").read_text(encoding="utf-8")
    sections = "".join(section for section in _sections(findings) if section)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style></head>\n"
        f"<body><main><header><h1>{escape(title)}</h1><p>{escape(seen(calibration))}</p></header>\n"
        f"{sections}</main></body></html>\n"
    )


def name_of(calibration: Calibration) -> str:
    """Return what to call the recording."""
    return str(calibration.source.get("name") or "a camera")


def seen(calibration: Calibration) -> str:
    """Return what the calibration rests on, in one line."""
    counts = calibration.counts
    parts = [f"{calibration.size[0]}×{calibration.size[1]} pixels", f"grey levels up to {calibration.max_grey}"]
    parts += [f"{counts[name]} {name}" for name in ("frames", "pairs", "samples") if name in counts]
    if counts.get("skipped"):
        parts.append(f"{counts['skipped']} frames skipped")
    return " · ".join(parts)


def _sections(findings: Findings) -> Iterator[str]:
    yield _verdict(findings)
    yield _curves(findings)
    yield _exposures(findings)
    yield _pictures(findings.examples)
    yield _tracking(findings.examples)
    yield _coverage(findings.calibration)
    yield _residuals(findings.calibration)
    yield _improvements(findings.calibration)
    yield _check(findings.check)
    yield _details(findings.calibration)


def _section(heading: str, *content: str, style: str = "") -> str:
    classes = f' class="{style}"' if style else ""
    return f"<section{classes}><h2>{escape(heading)}</h2>{''.join(content)}</section>\n"


def _paragraph(text: str, style: str = "") -> str:
    return f'<p class="{style}">{escape(text)}</p>' if style else f"<p>{escape(text)}</p>"


def _list(items: list[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>" if items else ""


def _parts(*figures: str) -> str:
    shown = [f"<div>{figure}</div>" for figure in figures if figure]
    return f'<div class="parts">{"".join(shown)}</div>' if shown else ""


def _verdict(findings: Findings) -> str:
    calibration = findings.calibration
    said = facts(calibration)
    if findings.examples.tracking is not None:
        sentence = findings.examples.tracking.sentence
        said.append(f"In an excerpt of this recording, {sentence[0].lower()}{sentence[1:]}")
    cards = [_verdict_part(name, verdict) for name, verdict in calibration.verdicts.items()]
    state = overall_state(calibration).split()[0]
    first = _paragraph(headline(calibration), "first")
    return _section("In short", first, _list(said), _parts(*cards), style=f"verdict {state}")


def _verdict_part(name: str, verdict: Verdict) -> str:
    remedy = _paragraph(verdict.remedy, "remedy") if verdict.remedy else ""
    return (
        f'<h3>{escape(name.capitalize())}: <span class="state {verdict.state.split()[0]}">{escape(verdict.state)}'
        f"</span></h3>{_paragraph(verdict.reason)}{remedy}"
    )


def _curves(findings: Findings) -> str:
    calibration, truth = findings.calibration, findings.truth
    figures = [_unknown(calibration, part) for part in ("response", "vignette")]
    if calibration.response is not None:
        figures[0] = "<h3>Response</h3>" + response_figure(calibration, truth)
    if calibration.vignette is not None:
        figures[1] = "<h3>Vignette</h3>" + vignette_figure(calibration, truth)
        figures.append("<h3>Vignette over the image</h3>" + vignette_map(calibration.vignette))
    said = "" if truth is None else _paragraph(f"Drawn against the reference {truth.name}; nothing is aligned.")
    return _section("Response and vignette", said, _parts(*figures))


def _unknown(calibration: Calibration, part: str) -> str:
    verdict = calibration.verdicts.get(part)
    reason = "" if verdict is None else f": {verdict.reason}"
    return f"<h3>{part.capitalize()}</h3>{_paragraph(f'Not known{reason}.', 'soft')}"


def _exposures(findings: Findings) -> str:
    ratios = findings.calibration.exposure_ratios
    if not ratios.metadata.size:
        return _section("Exposures", _paragraph("No pairs of frames could be compared.", "soft"))
    along = ""
    if findings.exposures_ms is not None and len(findings.exposures_ms) > int(ratios.frames.max()):
        along = evidence.exposures_figure(findings.exposures_ms, ratios)
    return _section("Exposures, stated and seen", _parts(along, evidence.ratios_figure(ratios)))


def _pictures(examples: Examples) -> str:
    notes = _list([note[0].upper() + note[1:] + "." for note in examples.notes])
    if not examples.pictures:
        return _section("Before and after", notes) if notes else ""
    said = _paragraph(
        "Frames of this recording as recorded, and the same as the camera would have recorded them without vignette "
        "and at the longer exposure of the two. The better the calibration, the more alike the corrected ones are."
    )
    return _section("Before and after", said, *(_picture_pair(pair) for pair in examples.pictures), notes)


def _picture_pair(pair: PicturePair) -> str:
    single = pair.frames[0] == pair.frames[1]
    cells = []
    for images, what in ((pair.recorded, "as recorded"), (pair.corrected, "corrected")):
        for image, frame, exposure_ms in zip(images, pair.frames, pair.exposures_ms, strict=True):
            text = f"frame {frame}, {exposure_ms:.4g} ms, {what}"
            uri = data_uri(image, ".jpg")
            cells.append(f'<figure><img src="{uri}" alt="{text}"><figcaption>{text}</figcaption></figure>')
    return f'<div class="pictures">{"".join(cells[::2] if single else cells)}</div>'


def _tracking(examples: Examples) -> str:
    tracking = examples.tracking
    if tracking is None:
        return ""
    rows = "".join(
        f'<tr><td>{escape(label)}<br><span class="soft">{escape(unit)}</span></td>'
        f'<td class="number">{before}</td><td class="number">{after}</td></tr>'
        for label, before, after, unit in tracking_rows(tracking)
    )
    return _section(
        "Does it help to track points?",
        _paragraph(tracking.sentence),
        '<table class="figures"><tr><th></th><th class="number">as recorded</th>'
        f'<th class="number">corrected</th></tr>{rows}</table>',
        _paragraph(
            f"{tracking.tracks} points, followed through frames {examples.tracked[0]} to {examples.tracked[1] - 1} "
            "by the same method with the same settings; exposures change by up to "
            f"{tracking.largest_step:.3g}:1 from frame to frame. 'ospc evaluate tracking' does the same for a whole "
            "recording.",
            "soft",
        ),
    )


def tracking_rows(tracking: TrackingComparison) -> list[tuple[str, str, str, str]]:
    """Return label, figure before, figure after and unit of each row of the table."""
    both = (tracking.raw, tracking.corrected)
    life = [f"{figures.mean_life:.1f}" for figures in both]
    lost = [f"{100 * sum(figures.lost.values()) / max(figures.steps, 1):.2f} %" for figures in both]
    residual = [f"{figures.residual:.3f}" for figures in both]
    return [
        ("mean life of a track", life[0], life[1], f"frames, of at most {tracking.horizon}"),
        ("lost", lost[0], lost[1], "of the steps from frame to frame"),
        ("brightness residual", residual[0], residual[1], "of the local contrast, median"),
    ]


def _coverage(calibration: Calibration) -> str:
    coverage = calibration.coverage
    if coverage is None:
        return ""
    figures = (
        evidence.grey_coverage_figure(coverage, calibration.max_grey),
        evidence.radius_coverage_figure(coverage),
    )
    return _section("What was seen", _parts(*figures))


def _residuals(calibration: Calibration) -> str:
    coverage = calibration.coverage
    if coverage is None or coverage.residual_by_grey is None:
        return ""
    by_grey, by_radius, by_place = coverage.residual_by_grey, coverage.residual_by_radius, coverage.residual_by_place
    figures = [evidence.grey_residual_figure(by_grey, calibration.max_grey)]
    if by_radius is not None:
        figures.append(evidence.radius_residual_figure(by_radius))
    if by_place is not None and np.isfinite(by_place).any():
        figures.append(evidence.place_residual_figure(by_place))
    return _section("What the calibration leaves unexplained", _parts(*figures))


def _improvements(calibration: Calibration) -> str:
    items = [advice[0].upper() + advice[1:] + "." for advice in calibration.advice if advice]
    items += gaps(calibration.coverage, calibration.max_grey)
    return _section("What would improve it", _list(items) or _paragraph("Nothing that this recording shows."))


def gaps(coverage: Coverage | None, max_grey: int) -> list[str]:
    """Return what the samples do not cover, and what to record for it, one sentence each."""
    if coverage is None:
        return []
    found = []
    if greys := uncovered_greys(coverage, max_grey):
        found.append(f"Hardly any sample has {greys}: film even surfaces that bright, at several exposures.")
    if radii := uncovered_radii(coverage):
        found.append(f"Hardly any sample lies at {radii} (1 = corner): let even surfaces pass there.")
    return found


def _check(check: Mapping[str, Any] | None) -> str:
    if check is None:
        return ""
    parts = [
        _verdict_part(str(name), Verdict(verdict["state"], str(verdict["reason"]), str(verdict["remedy"])))
        for name, verdict in check["verdicts"].items()
    ]
    return _section("Check of the recording", _parts(*parts), _list([str(note) for note in check["notes"]]))


def _details(calibration: Calibration) -> str:
    tables = [f"<h3>{heading}</h3>{_table(content)}" for heading, content in details(calibration).items() if content]
    return _section("Settings and versions", _parts(*tables))


def details(calibration: Calibration) -> dict[str, dict[str, Any]]:
    """Return everything that made the calibration what it is, by heading."""
    noise = {} if calibration.noise is None else vars(calibration.noise)
    return {
        "Settings": calibration.settings,
        "Recording": calibration.source,
        "Noise of a grey level": noise,
        "Versions": dict(calibration.versions),
    }


def _table(content: Mapping[str, Any]) -> str:
    rows = "".join(
        f"<tr><td>{escape(str(name))}</td><td><code>{escape(shown(value))}</code></td></tr>"
        for name, value in content.items()
    )
    return f"<table>{rows}</table>"


def shown(value: object) -> str:
    """Return a value of a setting as short text."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        text = ", ".join(shown(item) for item in value[:_LONGEST_LIST])
        return f"{text}, … ({len(value)} in all)" if len(value) > _LONGEST_LIST else text
    return value if isinstance(value, str) else json.dumps(value, default=str)
