"""``ospc convert``: write any recording as a folder that DSO and its descendants read."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.interruption import Interruption
from ospc.cli.progress import progress_bar
from ospc.cli.reading import Reading, reading_options

if TYPE_CHECKING:
    from ospc.recording.writing.conversion import Converted
    from ospc.recording.writing.images import ImageFormat

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells expect it: 128 + SIGINT."""


@dataclass(frozen=True)
class _Request:
    """What the user asked for."""

    path: Path
    out: Path
    reading: Reading
    image_format: ImageFormat | None
    archive: bool
    lag: int
    force: bool
    quiet: bool


@click.command("convert")
@click.argument("path", metavar="RECORDING", type=click.Path(path_type=Path))
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Folder to write, new or empty.")
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
@click.option(
    "--force", is_flag=True, help="Write into OUT even if it is not empty; files of the same names are replaced."
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
@reading_options
def command(**options: Any) -> None:
    """Write RECORDING in the layout of the TUM monocular data set, for DSO and its descendants.

    OUT gets images/ or images.zip, times.txt with integer ids, stamps in seconds and exposures in milliseconds, and
    camera.txt if the recording has intrinsics. If the conversion fails or is interrupted, OUT is as it was before.
    """
    request = _Request(reading=Reading.taken_from(options), **options)
    with Interruption() as interruption:
        try:
            converted = _convert(request, interruption)
        except KeyboardInterrupt:
            click.echo(f"ospc: interrupted; nothing was written to {request.out}", err=True)
            sys.exit(INTERRUPTED)
    if not request.quiet:
        camera = ", times.txt and camera.txt" if converted.has_camera else " and times.txt"
        click.echo(f"{converted.path}: {converted.frames} images ({converted.copied} of them copied){camera}")


def _convert(request: _Request, interruption: Interruption) -> Converted:
    from ospc.recording.derived import with_exposure_lag
    from ospc.recording.writing.conversion import convert_recording

    recording = with_exposure_lag(request.reading.open(request.path), request.lag)
    visible = not request.quiet and sys.stderr.isatty()
    with progress_bar("converting", len(recording), visible=visible) as show, interruption.deferred():

        def step(done: int, total: int) -> None:
            # Between two frames; what was written so far is removed.
            if interruption.requested:
                raise KeyboardInterrupt
            show(done, total)

        converted = convert_recording(
            recording,
            request.out,
            image_format=request.image_format,
            archive=request.archive,
            overwrite=request.force,
            progress=step,
        )
    if not request.quiet:
        for note in (*recording.notes, *converted.notes):
            click.echo(f"note: {note}", err=True)
    return converted
