"""``ospc record``: record a camera into a folder that can be calibrated."""

from __future__ import annotations

from pathlib import Path

import click

from ospc.cli.calibration_report import say_notes
from ospc.cli.interruption import Interruption
from ospc.cli.options import out_option, quiet_option
from ospc.cli.progress import progress_line
from ospc.cli.reading import stated_option
from ospc.cli.terminal import say
from ospc.errors import counted

_MAX_FRAMES = 1_000_000
"""Most frames of one recording: nine hours at 30 per second."""


@click.command("record")
@click.argument("camera")
@out_option(help="Folder to write, new or empty.")
@click.option(
    "-n", "--frames", type=click.IntRange(1, _MAX_FRAMES), help="Stop after this many frames; else with Ctrl-C."
)
@stated_option("channel")
@stated_option("exposure_unit")
@stated_option("gain_unit")
@quiet_option
@click.pass_obj
def command(
    interruption: Interruption, /, *, camera: str, out: Path, frames: int | None, quiet: bool, **stated: str | None
) -> None:
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

    with open_camera(camera, ReadingOptions.of(stated)) as source:
        if not quiet:
            say_notes(source.notes)
        with progress_line(quiet=quiet) as show, interruption.deferred():
            filmed = film(
                source,
                out,
                most=frames or _MAX_FRAMES,
                stop=lambda: interruption.requested,
                progress=lambda done, _most: show("recording", done, frames or 0),
            )
    if not quiet:
        low, high = filmed.exposure_range_ms
        repeated = f", {filmed.repeated} repeated ones left out" if filmed.repeated else ""
        say(f"{filmed.path}: {counted(filmed.frames, 'frame')} of {low:.4g} to {high:.4g} ms{repeated}")
