"""``ospc report``: write the report on an existing calibration again."""

from __future__ import annotations

from pathlib import Path

import click

from ospc.cli.options import TRUTH, argument, declared, option
from ospc.cli.reading import READING, Reading
from ospc.cli.terminal import say, say_notes
from ospc.errors import OspcError, RecordingError
from ospc.formats.opening import open_photometry
from ospc.photometry.calibration import Calibration
from ospc.recording import Recording, identity
from ospc.recording.options import ReadingOptions


@declared("report")
def command(
    *,
    folder: Path = argument(),
    recording: Path | None = option("Recording used for pictures and tracked points."),
    truth: str | None = TRUTH,
    reading: Reading = READING,
) -> None:
    """Write the report on the calibration in FOLDER again.

    FOLDER contains the calibration.json of 'ospc calibrate' or 'ospc merge'. An existing report.html is replaced.
    Without --recording, the new one has no pictures and no effect on tracking; without --truth, no comparison.
    """
    from ospc.report.output_folder import OutputFolder

    if not folder.is_dir():
        raise OspcError(f"{folder}: not a folder; give the folder that contains calibration.json")
    calibration = Calibration.load(folder)
    if recording is None and reading != Reading(ReadingOptions()):
        raise click.UsageError("options for reading a recording need --recording")
    frames = None if recording is None else reading.open(recording)
    about = "" if frames is None else _checked(frames, calibration)
    known = None if truth is None else open_photometry(truth, calibration.size)
    place = OutputFolder(folder)
    written = place.report(place.findings(calibration, frames, known), frames, about=about)
    say_notes([about] if about else [], "warning")
    if frames is None:
        name = calibration.source.get("name")
        given = f", here {name}" if isinstance(name, str) and name else ""
        say_notes(
            [
                "the report has no pictures and no effect on tracking; to add them, give the recording with "
                f"--recording{given}"
            ]
        )
    say_notes(written.notes)
    if written.problems:
        raise OspcError("; ".join(written.problems))
    for file in written.files:
        say(str(file))


def _checked(recording: Recording, calibration: Calibration) -> str:
    """Return what the report says if the calibration is not from this recording; empty if it is."""
    width, height = calibration.size
    if recording.size != calibration.size:
        raise RecordingError(
            f"{recording.path}: has images of {recording.size[0]}x{recording.size[1]} pixels, but the calibration is "
            f"for {width}x{height}; give a recording of this size"
        )
    source, shown = calibration.source, identity(recording)
    if source.get("images_sha256") in (None, shown["images_sha256"]):
        return ""
    if all(source.get(part) == shown[part] for part in ("name", "frames_sha256")):
        return (
            f"the calibration was made from other pixels of {shown['name']}; give the same --roi, --mask, --channel "
            "and --bayer"
        )
    name = source.get("name", "another recording")
    return f"pictures and points are from {recording.path.name}, but the calibration was made from {name}"
