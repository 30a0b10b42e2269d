"""``ospc correct``: correct the images of a recording for response and vignette."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ospc.cli.calibration_report import say_notes
from ospc.cli.interruption import INTERRUPTED, leaving
from ospc.cli.options import (
    PATH,
    assume_missing_option,
    exit_codes,
    force_option,
    kind_option,
    out_option,
    quiet_option,
)
from ospc.cli.progress import progress_of

_REASONS_SHOWN = 3


@click.command(
    "correct",
    epilog=exit_codes(
        {0: "written", INTERRUPTED: "interrupted; OUT holds part of the images and no times.txt"},
    ),
)
@click.argument("path", metavar="RECORDING", type=PATH)
@click.argument("calibration")
@out_option(help="Folder to write.")
@click.option(
    "--output",
    type=click.Choice(["irradiance", "grey8", "grey16"]),
    default="irradiance",
    show_default=True,
    help="32-bit float TIFF, or PNG of 8 or 16 bit; all linear in the irradiance.",
)
@click.option("--normalise-exposure", is_flag=True, help="Bring all images to one exposure.")
@click.option(
    "--reference-ms",
    type=float,
    metavar="MS",
    help="That exposure. By default 1 ms for irradiance, which makes it radiance per ms; the shortest of the "
    "recording for grey16; the median for grey8.",
)
@click.option(
    "--white",
    type=float,
    default=1.0,
    show_default=True,
    help="Irradiance that becomes the largest grey value; 1 saturates the camera where there is no vignette.",
)
@click.option("--mask-saturated", is_flag=True, help="Make saturated pixels NaN, or the largest grey value.")
@assume_missing_option
@kind_option
@force_option("Replace an earlier corrected recording in OUT.")
@quiet_option
def command(
    *, path: Path, calibration: str, out: Path, kind: str | None, force: bool, quiet: bool, **options: Any
) -> None:
    """Correct the images of RECORDING for response and vignette.

    CALIBRATION is a calibration.json or its folder, a pair 'pcalib.txt,vignette.png', a folder with these, or a file
    of hugin (.pto), Adobe (.lcp), lensfun (.xml) or OpenCV (.yml).

    OUT becomes a recording: images/, times.txt with the exposures of the corrected images, the original camera.txt,
    and correction.json, which describes the correction. With 8- and 16-bit images come a linear pcalib.txt and a
    constant vignette.png that are valid for them.

    Do this before any undistortion, rectification or scaling, never after it.
    """
    from ospc.correction.folder import CorrectedFolder
    from ospc.correction.recording import correct_recording
    from ospc.correction.settings import CorrectionSettings
    from ospc.formats.opening import open_photometry
    from ospc.recording import open_recording

    settings = CorrectionSettings(**options)
    recording = open_recording(path, kind)
    photometry = open_photometry(calibration, recording.size)
    folder = CorrectedFolder.at(out, recording.path, force=force)
    with leaving(f"{out} is unfinished"), progress_of("correcting", quiet=quiet) as step:
        result = correct_recording(recording, photometry, folder, settings, step)
    if quiet:
        return
    warn_of_assumed(result.assumed)
    if result.skipped:
        reasons = "; ".join(result.reasons[:_REASONS_SHOWN])
        click.echo(f"warning: {result.skipped} frames were skipped: {reasons}", err=True)
    say_notes(result.notes)
    click.echo(f"{result.path}: {len(result.frames)} images")
    click.echo(f"each pixel is {result.formula}")
    share = f"{result.saturated:.2%} of the pixels were saturated"
    click.echo(share + (f", {result.clipped:.2%} more are brighter than white" if result.clipped else ""))


def warn_of_assumed(parts: tuple[str, ...]) -> None:
    """Print on standard error which parts of a calibration are unknown and taken to be the identity."""
    for part in parts:
        means = {"response": "linear", "vignette": "none"}[part]
        click.echo(f"warning: the {part} is unknown and taken as {means}", err=True)
