"""The sections of a report, declared once for every kind of file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from ospc.errors import counted
from ospc.evaluation.tracking import TrackingComparison
from ospc.evaluation.tracks import TrackFigures
from ospc.photometry.calibration import Calibration, Verdict
from ospc.report.charts import Chart, Findings
from ospc.report.examples import Examples, Pictures
from ospc.report.words import facts, headline

SUMMARY = "Summary"
"""Heading of the first section."""

_LONGEST_LIST = 24
"""Entries of a list that are shown."""

_ABOUT_PICTURES = (
    "Frames of this recording as recorded, and as the camera would have recorded them without vignette and at the "
    "longer exposure of the two. The better the calibration, the more alike are the corrected frames."
)


@dataclass(frozen=True)
class Section:
    """A section of the report; what is empty is left out.

    It begins with paragraphs of text and a list of items. ``figures`` are rows of a table (label, as recorded,
    corrected, unit), followed by ``remark`` in small print; ``tables`` are names and values by their heading.
    """

    heading: str
    text: tuple[str, ...] = ()
    items: tuple[str, ...] = ()
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    charts: tuple[Chart, ...] = ()
    pictures: tuple[Pictures, ...] = ()
    figures: tuple[tuple[str, str, str, str], ...] = ()
    remark: str = ""
    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def sections_of(findings: Findings, examples: Examples) -> Iterator[Section]:
    """Give the sections in the order in which a report shows them; those with nothing to show are left out."""
    calibration, charts = findings.calibration, findings.charts

    def existing(*names: str) -> tuple[Chart, ...]:
        return tuple(charts[name] for name in names if name in charts)

    yield Section(
        SUMMARY, (headline(calibration),), tuple(facts(calibration, examples.tracking)), calibration.verdicts
    )
    reference = (
        () if findings.truth is None else (f"The reference is {findings.truth.name}; nothing is aligned to it.",)
    )
    yield Section("Response and vignette", reference, charts=existing("response", "vignette", "vignette map"))
    compared = existing("exposures", "ratios")
    yield Section("Exposures", () if compared else ("No pairs of frames could be compared.",), charts=compared)
    notes = tuple(sentence(note) for note in examples.notes)
    if examples.pictures or notes:
        about = (_ABOUT_PICTURES,) if examples.pictures else ()
        yield Section("Before and after", about, notes, pictures=examples.pictures)
    if examples.tracking is not None:
        yield _tracking(examples.tracking, *examples.tracked)
    for heading, names in (
        ("Coverage", ("grey coverage", "radius coverage")),
        ("Residuals", ("grey residual", "radius residual", "place residual")),
    ):
        if existing(*names):
            yield Section(heading, charts=existing(*names))
    improvements = [sentence(advice) for advice in calibration.advice if advice]
    nothing = () if improvements else ("This recording shows nothing to improve.",)
    yield Section("How to improve it", nothing, tuple(improvements))
    tables = {
        "Settings": calibration.settings,
        "Recording": calibration.source,
        "Noise of a grey level": {} if calibration.noise is None else vars(calibration.noise),
        "Versions": calibration.versions,
    }
    yield Section("Settings and versions", tables={heading: table for heading, table in tables.items() if table})


def _tracking(tracking: TrackingComparison, first: int, end: int) -> Section:
    remark = (
        f"{counted(tracking.tracks, 'point')}, tracked through frames {first} to {end - 1} by the same method with "
        f"the same settings; the exposure changes by up to {tracking.largest_step:.3g}:1 from frame to frame. "
        "'ospc evaluate tracking' does this for a whole recording."
    )
    rows = tuple(tracking_rows(tracking))
    return Section("Effect on tracking", (tracking.sentence,), figures=rows, remark=remark)


def tracking_rows(tracking: TrackingComparison) -> Iterator[tuple[str, str, str, str]]:
    """Give label, figure as recorded, figure corrected, and unit of each row."""
    causes = tuple(tracking.raw.lost)

    def figures(tracks: TrackFigures) -> list[str]:
        median = f"> {tracking.horizon}" if tracks.median_life is None else str(tracks.median_life)
        lost = [tracks.lost[cause] for cause in causes]
        shares = [f"{count / max(tracks.steps, 1):.2%}" for count in (sum(lost), *lost)]
        return [f"{tracks.mean_life:.1f}", median, *shares, f"{tracks.residual:.3f}"]

    labels = {
        "mean life of a track": f"frames, of at most {tracking.horizon}",
        "median life": "frames",
        "tracks lost": "of the steps from frame to frame",
        **{f"  {cause}": "" for cause in causes},
        "brightness residual": "of the local contrast, median",
    }
    for (label, unit), before, after in zip(
        labels.items(), figures(tracking.raw), figures(tracking.corrected), strict=True
    ):
        yield label, before, after, unit


def name_of(calibration: Calibration) -> str:
    """Return the name of the recording."""
    return str(calibration.source.get("name") or "a camera")


def basis_of(calibration: Calibration) -> str:
    """Return what the calibration was made from, on one line."""
    counts = calibration.counts
    parts = [f"{calibration.size[0]}×{calibration.size[1]} pixels", f"grey levels up to {calibration.max_grey}"]
    parts += [counted(counts[f"{noun}s"], noun) for noun in ("frame", "pair", "sample") if f"{noun}s" in counts]
    if counts.get("skipped"):
        parts.append(f"{counted(counts['skipped'], 'frame')} skipped")
    if calibration.partial:
        parts.append("partial")
    return " · ".join(parts)


def shown(value: object) -> str:
    """Return the value of a setting as short text."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        text = ", ".join(shown(item) for item in value[:_LONGEST_LIST])
        return f"{text}, … ({len(value)} in all)" if len(value) > _LONGEST_LIST else text
    return value if isinstance(value, str) else json.dumps(value, default=str)


def sentence(text: str) -> str:
    """Return a text as a sentence, with a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""
