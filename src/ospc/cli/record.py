"""``ospc record``: record a camera into a folder that can be calibrated."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ospc.cli.interruption import Interruption
from ospc.cli.progress import progress_bar
from ospc.cli.reading import stated_option

_MAX_FRAMES = 1_000_000
"""Most frames of one recording: nine hours at 30 per second."""


@click.command("record")
@click.argument("camera")
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Folder to write, new or empty.")
@click.option(
    "-n", "--frames", type=click.IntRange(1, _MAX_FRAMES), help="Stop after this many frames; else with Ctrl-C."
)
@stated_option("channel")
@stated_option("exposure_unit")
@stated_option("gain_unit")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def command(*, camera: str, out: Path, frames: int | None, quiet: bool, **stated: str | None) -> None:
    """Record CAMERA with the exposure of every frame, to be checked and calibrated.

    CAMERA is opencv:0 for the first webcam, realsense or realsense:SERIAL (extra 'realsense'), or depthai:left,
    depthai:right or depthai:colour (extra 'depthai'); realsense:FILE is a recording of RealSense's own viewer.
    With --channel, RealSense and DepthAI use their colour sensor. The units matter for opencv only: without
    --gain-unit the gain must stay constant.

    OUT gets images/ and times.txt. Ctrl-C stops the recording; what was recorded so far is complete.
    """
    from ospc.recording.live import open_camera
    from ospc.recording.options import ReadingOptions
    from ospc.recording.writing.filming import film

    visible = not quiet and sys.stderr.isatty()
    most = frames or _MAX_FRAMES
    with Interruption() as interruption, open_camera(camera, ReadingOptions.of(stated)) as source:
        if not quiet:
            for note in source.notes:
                click.echo(f"note: {note}", err=True)
        with progress_bar("recording", frames or 0, visible=visible) as show, interruption.deferred():
            filmed = film(source, out, most=most, stop=lambda: interruption.requested, progress=show)
    if not quiet:
        low, high = filmed.exposure_range_ms
        repeated = f", {filmed.repeated} repeated ones left out" if filmed.repeated else ""
        click.echo(f"{filmed.path}: {filmed.frames} frames of {low:.4g} to {high:.4g} ms{repeated}")
