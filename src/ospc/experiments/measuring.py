"""Runs methods over recordings, and compares what they find with the truth."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ospc.evaluation.comparison import compare
from ospc.experiments.methods import Timed
from ospc.experiments.sources import Source
from ospc.formats.opening import Photometry

FIGURES = ("response_rmse", "response_shape_rmse", "log_ratio_error", "vignette_rmse")
TITLES = {
    "response_rmse": "response, RMSE of g",
    "response_shape_rmse": "response shape, RMSE of s·g",
    "log_ratio_error": "log-ratio error κ",
    "vignette_rmse": "vignette, RMSE of the profile",
}

OnProgress = Callable[[str, int, int], None]
"""Told the recording, how many frames are done, and of how many."""


@dataclass(frozen=True)
class Measurement:
    """A method on a recording.

    Attributes
    ----------
    recording, method
        Names.
    figures
        By name as in :data:`FIGURES`; None for what the method did not find.
    seconds
        Processor time; that of all variants together where a method has several.
    failure
        Why there are no figures; empty if there are.
    """

    recording: str
    method: str
    figures: dict[str, float | None]
    seconds: float
    failure: str = ""

    def value(self, figure: str) -> float:
        """Return a figure; infinite where it is missing."""
        found = self.figures.get(figure)
        return math.inf if found is None else found


@dataclass(frozen=True)
class Measured:
    """All methods on a recording.

    Attributes
    ----------
    source
        The recording.
    rows
        How good they are.
    found
        What they found, where they did.
    """

    source: Source
    rows: tuple[Measurement, ...]
    found: dict[str, Photometry] = field(repr=False)


def measure(
    source: Source,
    rivals: Sequence[Timed],
    progress: OnProgress = lambda _name, _done, _of: None,
    others: Iterable[Photometry] = (),
) -> Measured:
    """Run methods over a recording in one pass, and compare them with its truth.

    Parameters
    ----------
    source
        The recording.
    rivals
        The methods, new ones.
    progress
        Told how far it is.
    others
        Calibrations by other programs, to be compared too.
    """
    for done, frame in enumerate(source.open(), start=1):
        for rival in rivals:
            rival.push(frame)
        progress(source.name, done, source.count)
    rows: list[Measurement] = []
    found: dict[str, Photometry] = {}
    for rival in rivals:
        for name, result in rival.found().items():
            rows.append(_row(source, name, result, rival.seconds))
            if isinstance(result, Photometry):
                found[name] = result
    for other in others:
        rows.append(_row(source, other.name, other, math.nan))
        found[other.name] = other
    return Measured(source, tuple(rows), found)


def _row(source: Source, name: str, result: Photometry | str, seconds: float) -> Measurement:
    if isinstance(result, str):
        return Measurement(source.name, name, {}, seconds, result)
    if result.response is None and result.vignette is None:
        return Measurement(source.name, name, {}, seconds, "it found neither response nor vignette")
    comparison = compare(result, source.truth)
    return Measurement(source.name, name, {figure: getattr(comparison, figure) for figure in FIGURES}, seconds)


def medians(rows: Sequence[Measurement], figure: str) -> dict[str, float]:
    """Return the median of a figure over recordings by method, in order; what is missing counts as infinite."""
    names = list(dict.fromkeys(row.method for row in rows))
    return {name: float(np.median([row.value(figure) for row in rows if row.method == name])) for name in names}


def as_csv(rows: Sequence[Measurement]) -> str:
    """Return one line a measurement, with a heading."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["recording", "method", *FIGURES, "seconds", "failure"])
    for row in rows:
        cells = ["" if row.figures.get(f) is None else f"{row.figures[f]:.6g}" for f in FIGURES]
        seconds = f"{row.seconds:.3g}" if math.isfinite(row.seconds) else ""
        writer.writerow([row.recording, row.method, *cells, seconds, row.failure])
    return text.getvalue()


def as_markdown(rows: Sequence[Measurement]) -> str:
    """Return the medians over recordings, one line a method, the lowest of each column bold."""
    columns = {figure: medians(rows, figure) for figure in FIGURES}
    lines = ["| method | " + " | ".join(TITLES[f] for f in FIGURES) + " | failed |", "|---|" + "---:|" * 5]
    recordings = len({row.recording for row in rows})
    for name in columns[FIGURES[0]]:
        cells = []
        for figure in FIGURES:
            value = columns[figure][name]
            text = f"{value:.4f}" if math.isfinite(value) else "–"
            cells.append(f"**{text}**" if math.isfinite(value) and value == min(columns[figure].values()) else text)
        failed = sum(bool(row.failure) for row in rows if row.method == name)
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {failed}/{recordings} |")
    return "\n".join(lines) + "\n"
