"""``ospc correct``: correct the images of a recording for response and vignette."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.progress import progress_bar

if TYPE_CHECKING:
    from ospc.correction.result import Corrected

INTERRUPTED = 130


@click.command("correct")
@click.argument("path", metavar="RECORDING", type=click.Path(path_type=Path))
@click.argument("calibration")
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Folder to write.")
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
@click.option(
    "--assume-missing", is_flag=True, help="Take an unknown response as linear, and an unknown vignette as none."
)
@click.option("--kind", help="Kind of recording (tum_mono, euroc, …); by default recognised.")
@click.option("--force", is_flag=True, help="Replace an earlier corrected recording in OUT.")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors.")
def command(
    *,
    path: Path,
    calibration: str,
    out: Path,
    kind: str | None,
    force: bool,
    quiet: bool,
    **options: Any,
) -> None:
    r"""Correct the images of RECORDING for response and vignette.

    CALIBRATION is a calibration.json or its folder, a pair 'pcalib.txt,vignette.png', a folder with these, or a file
    of hugin (.pto), Adobe (.lcp), lensfun (.xml) or OpenCV (.yml).

    OUT becomes a recording: images/, times.txt with the exposures of the corrected images, the original camera.txt,
    and correction.json, which describes the correction. With 8- and 16-bit images come a linear pcalib.txt and a
    constant vignette.png that are valid for them.

    Do this before any undistortion, rectification or scaling, never after it.

    \b
    Exit codes:
      0    written
      1    error
      2    wrong usage
      130  interrupted; OUT holds part of the images and no times.txt
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
    try:
        with progress_bar("correcting", len(recording), visible=not quiet and sys.stderr.isatty()) as progress:
            result = correct_recording(recording, photometry, folder, settings, progress)
    except KeyboardInterrupt:
        click.echo(f"ospc: interrupted; {out} is unfinished", err=True)
        sys.exit(INTERRUPTED)
    if not quiet:
        _report(result)


def warn_of_assumed(parts: tuple[str, ...]) -> None:
    """Print on standard error which parts of a calibration are unknown and taken to be the identity."""
    for part in parts:
        means = {"response": "linear", "vignette": "none"}[part]
        click.echo(f"warning: the {part} is unknown and taken as {means}", err=True)


def _report(result: Corrected) -> None:
    warn_of_assumed(result.assumed)
    if result.skipped:
        shown = "; ".join(result.reasons[:3])
        click.echo(f"warning: {result.skipped} frames were skipped: {shown}", err=True)
    for note in result.notes:
        click.echo(f"note: {note}", err=True)
    click.echo(f"{result.path}: {len(result.frames)} images")
    click.echo(f"each pixel is {result.formula}")
    share = f"{result.saturated:.2%} of the pixels were saturated"
    click.echo(share + (f", {result.clipped:.2%} more are brighter than white" if result.clipped else ""))
