"""``ospc report``: write the report on an existing calibration again."""

from __future__ import annotations

from pathlib import Path

from ospc.cli.options import TRUTH, argument, declared, option
from ospc.cli.reading import READING, Reading
from ospc.cli.terminal import say, say_notes
from ospc.errors import OspcError


@declared("report")
def command(
    *,
    folder: Path = argument(),
    recording: Path | None = option("Recording used for pictures and tracked points."),
    truth: str | None = TRUTH,
    pdf: bool = option("Also write report.pdf."),
    reading: Reading = READING,
) -> None:
    """Write the report on the calibration in FOLDER again.

    FOLDER contains the calibration.json of 'ospc calibrate' or 'ospc merge'. An earlier report.html is replaced.
    """
    from ospc.formats.opening import open_photometry
    from ospc.output import OutputFolder
    from ospc.photometry.calibration import Calibration

    if not folder.is_dir():
        raise OspcError(f"{folder}: not a folder; give the folder that contains calibration.json")
    calibration = Calibration.load(folder)
    frames = None if recording is None else reading.open(recording)
    known = None if truth is None else open_photometry(truth)
    place = OutputFolder(folder)
    written = place.report(place.findings(calibration, frames, known), frames, pdf=pdf)
    say_notes(written.notes)
    if written.problems:
        raise OspcError("; ".join(written.problems))
    for file in written.files:
        say(str(file))
