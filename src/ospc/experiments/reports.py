"""Makes an experiment and writes its tables and pictures into a folder, after every recording."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ospc.atomic import write_atomically
from ospc.errors import SettingError
from ospc.experiments.ambiguity import as_csv as ambiguity_csv
from ospc.experiments.ambiguity import show_ambiguity, starts_as_csv
from ospc.experiments.design import Experiment
from ospc.experiments.measuring import Measured, Measurement, OnProgress, Others, as_csv, as_markdown, measure
from ospc.experiments.methods import Ours, Paper, Timed
from ospc.experiments.pictures import draw_ambiguity, draw_curves, draw_errors
from ospc.experiments.sources import Source
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.vignette import radial_profile


@dataclass
class Report:
    """What an experiment wrote.

    Attributes
    ----------
    rows
        All measurements.
    files
        Files written.
    problems
        What could not be drawn, and why.
    """

    rows: list[Measurement] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def make_experiment(
    experiment: Experiment,
    sources: Sequence[Source],
    folder: Path,
    progress: OnProgress,
    others: Others | None = None,
) -> Report:
    """Run an experiment over recordings.

    Parameters
    ----------
    experiment
        The experiment.
    sources
        The recordings.
    folder
        Where to; ``measurements.csv``, ``table.md``, ``errors.png``, and for every recording a picture and a table of
        the curves.
    progress
        Told how far it is.
    others
        What other programs found, to be compared with the truth too.

    Raises
    ------
    SettingError
        If the folder cannot be written.
    OspcError
        If a recording cannot be read.
    """
    report = Report()
    for source in sources:
        rivals = experiment.methods(source)
        measured = measure(source, rivals, progress, others)
        report.rows += measured.rows
        _write(report, folder / f"curves-{source.name}.csv", _curves(measured))
        _write(report, folder / "measurements.csv", as_csv(report.rows))
        _write(report, folder / "table.md", as_markdown(report.rows))
        ratios = _ratios(rivals, measured) if experiment.name == "parameters" else {}
        if ratios:
            _write(report, folder / f"ratios-{source.name}.csv", _ratios_csv(ratios))
        if not experiment.varied:
            report.files.append(draw_curves(measured, folder / f"curves-{source.name}.png", ratios))
        report.files.append(draw_errors(experiment, report.rows, folder / "errors.png"))
    report.files = list(dict.fromkeys(report.files))
    return report


def make_ambiguity(source: Source, folder: Path, progress: OnProgress) -> Report:
    """Show the exponential ambiguity on a recording; writes ``ambiguity.csv``, ``starts.csv`` and ``ambiguity.png``.

    Raises
    ------
    OspcError
        If the recording cannot be read or shows nothing, or the folder cannot be written.
    """
    found = show_ambiguity(source, progress)
    report = Report()
    _write(report, folder / "ambiguity.csv", ambiguity_csv(found))
    _write(report, folder / "starts.csv", starts_as_csv(found))
    report.files.append(draw_ambiguity(found, folder / "ambiguity.png", source.name))
    return report


def _write(report: Report, path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        report.files.append(write_atomically(path, text.encode()))
    except OSError as error:
        raise SettingError(f"{path}: cannot be written ({error.strerror}); choose another folder") from None


def _curves(measured: Measured) -> str:
    """Return g at 256 grey levels and V at 50 radii, one column a method, truth first."""
    columns = {"truth": measured.source.truth, **measured.found}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["curve", "at", *columns])
    greys = np.arange(256)
    tables = [None if p.response is None else p.response.inverse(greys / 255) for p in columns.values()]
    for grey in greys:
        writer.writerow(["g", grey, *("" if t is None else f"{t[grey]:.6g}" for t in tables)])
    profiles = [None if p.vignette is None else radial_profile(p.vignette) for p in columns.values()]
    for place in range(50):
        values = ("" if t is None else f"{t[place] / t[:3].mean():.6g}" for t in profiles)
        writer.writerow(["V", f"{(place + 0.5) / 50:.2f}", *values])
    return text.getvalue()


def _ratios(rivals: Sequence[Timed], measured: Measured) -> dict[str, ExposureRatios]:
    found: dict[str, ExposureRatios] = {}
    for timed in rivals:
        if isinstance(timed.rival, Paper):
            found.update(timed.rival.ratios)
        elif isinstance(timed.rival, Ours):
            calibration = measured.found["ours"].calibration if "ours" in measured.found else None
            if calibration is not None:
                found["ours"] = calibration.exposure_ratios
    return found


def _ratios_csv(ratios: dict[str, ExposureRatios]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "first", "second", "metadata", "estimated", "samples"])
    for name, found in ratios.items():
        writer.writerows(
            [name, *pair, f"{k:.6g}", f"{estimate:.6g}", samples]
            for pair, k, estimate, samples in zip(
                found.frames.tolist(), found.metadata, found.estimated, found.samples.tolist(), strict=True
            )
        )
    return text.getvalue()
