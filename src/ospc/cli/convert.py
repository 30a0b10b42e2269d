"""``ospc convert``: write any recording as a folder that DSO and its descendants read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.calibration_report import say_notes
from ospc.cli.interruption import Interruption, leaving
from ospc.cli.options import PATH, force_option, out_option, quiet_option
from ospc.cli.progress import progress_of
from ospc.cli.reading import Reading, reading_options
from ospc.cli.terminal import say
from ospc.errors import counted

if TYPE_CHECKING:
    from ospc.recording.writing.images import ImageFormat


@click.command("convert")
@click.argument("path", metavar="RECORDING", type=PATH)
@out_option(help="Folder to write, new or empty.")
@click.option(
    "--format",
    "image_format",
    type=click.Choice(["png", "jpg"]),
    help="Format of the images. By default files are copied if possible and written as PNG otherwise.",
)
@click.option("--zip", "archive", is_flag=True, help="Write images.zip instead of images/.")
@click.option(
    "--lag",
    type=int,
    default=0,
    metavar="FRAMES",
    help="Move exposures that come this many frames late to their frames; 'ospc check' finds the number.",
)
@force_option("Write into OUT even if it is not empty; files of the same names are replaced.")
@quiet_option
@reading_options
@click.pass_obj
def command(
    interruption: Interruption,
    /,
    *,
    path: Path,
    out: Path,
    image_format: ImageFormat | None,
    archive: bool,
    lag: int,
    force: bool,
    quiet: bool,
    **reading: Any,
) -> None:
    """Write RECORDING in the layout of the TUM monocular data set, for DSO and its descendants.

    OUT gets images/ or images.zip, times.txt with integer ids, stamps in seconds and exposures in milliseconds, and
    camera.txt if the recording has intrinsics. If the conversion fails or is interrupted, OUT is as it was before.
    """
    from ospc.recording.derived import with_exposure_lag
    from ospc.recording.writing.conversion import convert_recording

    recording = with_exposure_lag(Reading.taken_from(reading).open(path), lag)
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
