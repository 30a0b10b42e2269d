"""``ospc convert``: any recording as a folder that DSO and its descendants read."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from ospc.cli.progress import progress_bar

INTERRUPTED = 130


@click.command("convert")
@click.argument("path", metavar="RECORDING", type=click.Path(path_type=Path))
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Folder to write, new or empty.")
@click.option("--kind", help="Kind of recording, instead of recognising it (tum_mono, euroc, …).")
@click.option(
    "--format",
    "image_format",
    type=click.Choice(["png", "jpg"]),
    help="Format of the images. By default files are copied where that is possible, and PNG otherwise.",
)
@click.option("--zip", "archive", is_flag=True, help="Write images.zip instead of images/.")
@click.option(
    "--lag",
    type=int,
    default=0,
    metavar="FRAMES",
    help="Move exposures that come late by so many frames to where they belong; 'ospc check' finds the number.",
)
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors.")
def command(
    *, path: Path, out: Path, kind: str | None, image_format: Any, archive: bool, lag: int, quiet: bool
) -> None:
    """Write RECORDING in the layout of the TUM monocular data set, for DSO and its descendants.

    OUT gets images/ or images.zip, times.txt with integer ids, stamps in seconds and exposures in milliseconds, and
    camera.txt if the recording has one. Nothing is left of it if the conversion fails.
    """
    from ospc.diagnosis.lag import corrected
    from ospc.formats.conversion import convert_recording
    from ospc.recording import open_recording

    recording = corrected(open_recording(path, kind), lag)
    try:
        with progress_bar("converting", len(recording), visible=not quiet and sys.stderr.isatty()) as progress:
            result = convert_recording(recording, out, image_format=image_format, archive=archive, progress=progress)
    except KeyboardInterrupt:
        click.echo(f"ospc: interrupted; nothing is left in {out}", err=True)
        sys.exit(INTERRUPTED)
    if quiet:
        return
    for note in (*recording.notes, *result.notes):
        click.echo(f"note: {note}", err=True)
    click.echo(f"{result.path}: {result.frames} images, {result.copied} of them copied, and times.txt")
