"""``ospc record``: film with a camera into a folder that can be calibrated."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ospc.cli.interruption import Interruption
from ospc.cli.progress import progress_bar


@click.command("record")
@click.argument("camera")
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Folder to write, new or empty.")
@click.option("-n", "--frames", type=click.IntRange(1, 1_000_000), help="End after so many frames; else with Ctrl-C.")
@click.option(
    "--channel",
    type=click.Choice(["luminance", "red", "green", "blue"]),
    help="Channel of a colour camera; asks RealSense and DepthAI for their colour sensor.",
)
@click.option(
    "--exposure-unit",
    type=click.Choice(["s", "ms", "us", "ns", "100us", "log2s"]),
    help="Unit of the exposures that OpenCV's driver gives, where it is not known.",
)
@click.option(
    "--gain-unit",
    type=click.Choice(["linear", "db", "iso", "none"]),
    help="Unit of the gains that OpenCV's driver gives; without it the gain must not change.",
)
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but errors.")
def command(
    *,
    camera: str,
    out: Path,
    frames: int | None,
    channel: str | None,
    exposure_unit: str | None,
    gain_unit: str | None,
    quiet: bool,
) -> None:
    """Record CAMERA with the exposure of every frame, to be checked and calibrated.

    CAMERA is opencv:0 for the first webcam, realsense or realsense:SERIAL (extra 'realsense'), or depthai:left,
    depthai:right or depthai:colour (extra 'depthai'); realsense:FILE is a recording of RealSense's own viewer.

    OUT gets images/ and times.txt. Ctrl-C ends the recording; what was filmed by then is complete.
    """
    from ospc.formats.filming import film
    from ospc.recording.channel import Channel
    from ospc.recording.exposure_units import ExposureUnit, GainUnit
    from ospc.recording.live import open_camera
    from ospc.recording.options import ReadingOptions

    options = ReadingOptions(
        channel=Channel(channel) if channel else None,
        exposure_unit=ExposureUnit(exposure_unit) if exposure_unit else None,
        gain_unit=GainUnit(gain_unit) if gain_unit else None,
    )
    visible = not quiet and sys.stderr.isatty()
    with Interruption() as interruption, open_camera(camera, options) as source:
        if not quiet:
            for note in source.notes:
                click.echo(f"note: {note}", err=True)
        with progress_bar("recording", frames or 0, visible=visible) as show, interruption.deferred():
            filmed = film(source, out, most=frames or 1_000_000, stop=lambda: interruption.requested, progress=show)
    if not quiet:
        low, high = filmed.exposure_range_ms
        repeated = f", {filmed.repeated} repeated ones left out" if filmed.repeated else ""
        click.echo(f"{filmed.path}: {filmed.frames} frames of {low:.4g} to {high:.4g} ms{repeated}")
