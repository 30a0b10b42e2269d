"""Runs methods over recordings, and compares what they find with the truth."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ospc.errors import ExposureError, FormatError
from ospc.evaluation.comparison import compare
from ospc.experiments.methods import Exposures, Timed
from ospc.experiments.sources import Source
from ospc.formats.files import read_text
from ospc.formats.opening import Photometry

FIGURES = ("response_rmse", "response_shape_rmse", "log_ratio_error", "vignette_rmse", "exposure_error")
TITLES = {
    "response_rmse": "response, RMSE of g",
    "response_shape_rmse": "response shape, RMSE of s·g",
    "log_ratio_error": "log-ratio error κ",
    "vignette_rmse": "vignette, RMSE of the profile",
    "exposure_error": "exposures, RMSE of ln e",
}

_MOST_BYTES = 64_000_000

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
class Others:
    """What other programs found on a recording.

    Attributes
    ----------
    calibrations
        Named calibrations.
    exposures
        Estimated exposures by name; those of the same name as a calibration belong to it.
    """

    calibrations: tuple[Photometry, ...] = ()
    exposures: Mapping[str, Exposures] = field(default_factory=dict)


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
    others: Others | None = None,
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
        What other programs found, to be compared too.
    """
    others = others or Others()
    metadata: dict[int, float] = {}
    for done, frame in enumerate(source.open(), start=1):
        metadata[frame.index] = frame.exposure_ms
        for rival in rivals:
            rival.push(frame)
        progress(source.name, done, source.count)
    rows: list[Measurement] = []
    found: dict[str, Photometry] = {}
    estimated = dict(others.exposures)
    for rival in rivals:
        results = rival.found()
        estimated.update(rival.exposures)
        rows += [_row(source, name, result, rival.seconds) for name, result in results.items()]
        found.update({name: result for name, result in results.items() if isinstance(result, Photometry)})
    for other in others.calibrations:
        rows.append(_row(source, other.name, other, math.nan))
        found[other.name] = other
    for name in estimated.keys() - {row.method for row in rows}:
        rows.append(Measurement(source.name, name, {}, math.nan))
    errors = {name: exposure_error(one, metadata) for name, one in estimated.items()}
    rows = [replace(row, figures={**row.figures, "exposure_error": errors.get(row.method)}) for row in rows]
    return Measured(source, tuple(rows), found)


def exposure_error(estimate: Exposures, metadata: Mapping[int, float]) -> float:
    """Return the root mean square error of ln e after the best common factor, which cannot be observed.

    Parameters
    ----------
    estimate
        The exposures.
    metadata
        True exposures by frame.

    Raises
    ------
    ExposureError
        If an estimate is not positive, or of a frame that the recording does not have.
    """
    if not np.all(np.isfinite(estimate.values) & (estimate.values > 0)):
        raise ExposureError("estimated exposures must be finite and above 0")
    unknown = [int(frame) for frame in estimate.frames if int(frame) not in metadata]
    if unknown or not estimate.frames.size:
        raise ExposureError(
            f"exposures were estimated for {estimate.frames.size} frames, of which the recording lacks "
            f"{len(unknown)}; give one a frame"
        )
    difference = np.log(estimate.values) - np.log([metadata[int(frame)] for frame in estimate.frames])
    return float(np.std(difference))


def read_exposures(path: str | Path) -> Exposures:
    """Read exposures estimated by another program: the last number of each line, one line a frame.

    Raises
    ------
    FormatError
        If a line does not end with a number.
    """
    lines = [line for line in read_text(path, _MOST_BYTES).splitlines() if line.strip() and line.lstrip()[0] != "#"]
    try:
        values = np.array([float(line.replace(",", " ").split()[-1]) for line in lines], dtype=np.float64)
    except (ValueError, IndexError):
        raise FormatError(f"{path}: does not end every line with an exposure, one line a frame") from None
    return Exposures(np.arange(values.size), values)


def _row(source: Source, name: str, result: Photometry | str, seconds: float) -> Measurement:
    if isinstance(result, str):
        return Measurement(source.name, name, {}, seconds, result)
    if result.response is None and result.vignette is None:
        return Measurement(source.name, name, {}, seconds, "it found neither response nor vignette")
    comparison = compare(result, source.truth)
    return Measurement(source.name, name, {figure: getattr(comparison, figure) for figure in FIGURES[:-1]}, seconds)


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
    lines = [
        "| method | " + " | ".join(TITLES[f] for f in FIGURES) + " | failed |",
        "|---|" + "---:|" * (len(FIGURES) + 1),
    ]
    recordings = len({row.recording for row in rows})
    for name in columns[FIGURES[0]]:
        cells = []
        for figure in FIGURES:
            value = columns[figure][name]
            text = f"{value:.4f}" if math.isfinite(value) else "–"
            best = math.isfinite(value) and value == min(columns[figure].values())
            cells.append(f"**{text}**" if best else text)
        failed = sum(bool(row.failure) for row in rows if row.method == name)
        lines.append(f"| {name} | " + " | ".join(cells) + f" | {failed}/{recordings} |")
    return "\n".join(lines) + "\n"
