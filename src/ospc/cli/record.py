"""``ospc record``: record a camera with the exposure of every frame."""

from __future__ import annotations

from pathlib import Path

import click

from ospc.cli.interruption import Interruption
from ospc.cli.options import QUIET, argument, declared, option, out_option
from ospc.cli.reading import STATED_OF_CAMERA
from ospc.cli.terminal import progress_line, say, say_notes
from ospc.errors import counted
from ospc.exposures.table import range_in_words
from ospc.recording.options import ReadingOptions
from ospc.recording.writing.images import MOST_FRAMES, film


@declared("record")
def command(
    interruption: Interruption,
    *,
    camera: str = argument(),
    out: Path = out_option("Folder to write, new or empty."),
    frames: int | None = option(
        "Stop after this many frames; otherwise with Ctrl-C.", "-n", "--frames", type=click.IntRange(1, MOST_FRAMES)
    ),
    stated: ReadingOptions = STATED_OF_CAMERA,
    quiet: bool = QUIET,
) -> None:
    """Record CAMERA with the exposure of every frame, for 'ospc check' and 'ospc calibrate'.

    CAMERA is opencv:0 for the first webcam, realsense or realsense:SERIAL (extra 'realsense'), or depthai:left,
    depthai:right or depthai:colour (extra 'depthai'); realsense:FILE is a recording made with RealSense's viewer.
    With --channel, RealSense and DepthAI use their colour sensor. The units apply to opencv only: without
    --gain-unit, the gain must stay constant.

    OUT gets images/ and times.txt. Ctrl-C stops the recording; the frames recorded so far are complete.
    """
    from ospc.recording.live import open_camera

    with open_camera(camera, stated) as source:
        if not quiet:
            say_notes(source.notes)
        with progress_line(quiet=quiet) as show, interruption.deferred():
            filmed = film(
                source,
                out,
                most=frames or MOST_FRAMES,
                stop=lambda: interruption.requested,
                progress=lambda done, _most: show("recording", done, frames or 0),
            )
    if not quiet:
        low, high = filmed.exposure_range_ms
        repeated = f", {filmed.repeated} repeated ones left out" if filmed.repeated else ""
        say(f"{filmed.path}: {counted(filmed.frames, 'frame')} of {range_in_words(low, high)}{repeated}")
        if filmed.clock_steps:
            steps = counted(filmed.clock_steps, "time")
            say_notes([f"the clock of the camera was set back {steps}; the time stamps continue"])
