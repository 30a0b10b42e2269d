"""``ospc convert``: convert a recording to a folder that DSO and its descendants read."""

from __future__ import annotations

from pathlib import Path

import click

from ospc.cli.interruption import Interruption, leaving
from ospc.cli.options import QUIET, argument, declared, option, out_option
from ospc.cli.reading import KIND, STATED, Reading
from ospc.cli.terminal import progress_of, say, say_notes
from ospc.errors import counted
from ospc.recording.derived import with_exposure_lag
from ospc.recording.options import ReadingOptions
from ospc.recording.writing.conversion import convert_recording
from ospc.recording.writing.images import ImageFormat


@declared("convert")
def command(
    interruption: Interruption,
    *,
    path: Path = argument(metavar="RECORDING"),
    out: Path = out_option("Folder to write, new or empty."),
    image_format: ImageFormat | None = option(
        "Format of the images. By default, files are copied if possible and written as PNG otherwise.",
        "--format",
        type=click.Choice(["png", "jpg"]),
    ),
    archive: bool = option("Write images.zip instead of images/.", "--zip"),
    lag: int = option(
        "Correct exposures that are this many frames late; 'ospc check' determines the number.",
        default=0,
        metavar="FRAMES",
    ),
    force: bool = option("Write into OUT even if it is not empty; files of the same names are replaced."),
    quiet: bool = QUIET,
    kind: str | None = KIND,
    stated: ReadingOptions = STATED,
) -> None:
    """Write RECORDING in the layout of the TUM monocular data set, for DSO and its descendants.

    OUT gets images/ or images.zip, times.txt with integer ids, stamps in seconds and exposures in milliseconds, and
    camera.txt if the recording has intrinsics. If the conversion fails or is interrupted, OUT stays unchanged.
    """
    recording = with_exposure_lag(Reading(stated, kind).open(path), lag)
    with (
        leaving(f"nothing was written to {out}"),
        progress_of("converting", quiet=quiet, interruption=interruption) as step,
    ):
        converted = convert_recording(
            recording, out, image_format=image_format, archive=archive, overwrite=force, progress=step
        )
    if not quiet:
        say_notes((*recording.notes, *converted.notes))
        camera = ", times.txt and camera.txt" if converted.has_camera else " and times.txt"
        say(f"{converted.path}: {counted(converted.frames, 'image')} ({converted.copied} of them copied){camera}")
