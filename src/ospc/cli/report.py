"""``ospc report``: write the report on an existing calibration again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ospc.cli.calibration_report import say_notes
from ospc.cli.options import PATH, truth_option
from ospc.cli.reading import Reading, reading_options
from ospc.cli.terminal import say
from ospc.errors import OspcError


@click.command("report")
@click.argument("folder", type=PATH)
@click.option("--recording", type=PATH, help="Recording from which to show pictures and track points.")
@truth_option
@click.option("--pdf", is_flag=True, help="Write report.pdf too.")
@reading_options
def command(folder: Path, recording: Path | None, truth: str | None, pdf: bool, **options: Any) -> None:
    """Write the report on the calibration in FOLDER again.

    FOLDER holds the calibration.json of 'ospc calibrate' or 'ospc merge'. An earlier report.html is replaced.
    """
    from ospc.formats.opening import open_photometry
    from ospc.output import OutputFolder
    from ospc.photometry.calibration import Calibration

    if not folder.is_dir():
        raise OspcError(f"{folder}: not a folder; give the folder that holds calibration.json")
    calibration = Calibration.load(folder)
    frames = None if recording is None else Reading.taken_from(options).open(recording)
    known = None if truth is None else open_photometry(truth)
    written = OutputFolder(folder).report(calibration, frames, known, pdf=pdf)
    say_notes(written.notes)
    if written.problems:
        raise OspcError("; ".join(written.problems))
    for file in written.files:
        say(str(file))
