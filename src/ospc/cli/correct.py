"""``ospc correct``: correct images for response and vignette."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from ospc.cli.interruption import leaving
from ospc.cli.options import ASSUME_MISSING, QUIET, argument, declared, option, out_option
from ospc.cli.reading import KIND, STATED_IN_COLOUR
from ospc.cli.terminal import INTERRUPTED, progress_of, say, say_notes
from ospc.correction.settings import CorrectionSettings, Output
from ospc.errors import counted
from ospc.recording.channel import Channel
from ospc.recording.options import ReadingOptions

_REASONS_SHOWN = 3


@declared("correct", exits={0: "written", INTERRUPTED: "interrupted; the same command completes OUT"})
def command(
    *,
    sources: tuple[Path, ...] = argument(metavar="SOURCE...", required=True),
    calibration: str = argument(),
    out: Path = out_option("Folder to write."),
    output: Output | None = option(
        "32-bit float TIFF (irradiance), or 8- or 16-bit PNG, all linear in the irradiance. The default is "
        "irradiance, or the bit depth of the originals with --keep-response.",
        type=click.Choice(["irradiance", "grey8", "grey16"]),
    ),
    keep_response: bool = option(
        "Remove only the vignette: write the grey levels that the camera would have recorded without it, as PNG, "
        "TIFF or JPEG like the originals. Values of 9 to 15 bits are scaled to 16; those of 8 are written in 8, even "
        "if the originals store them in 16."
    ),
    normalise_exposure: bool = option("Normalise all images to one exposure; requires a SOURCE with exposures."),
    reference_ms: float | None = option(
        "Exposure for --normalise-exposure. The default is 1 ms for irradiance, which gives radiance per ms; the "
        "shortest exposure of the recording for grey16; the median for grey8.",
        metavar="MS",
    ),
    white: float = option(
        "Irradiance that becomes the largest grey value; 1 saturates the camera where there is no vignette.",
        default=1.0,
    ),
    mask_saturated: bool = option("Set saturated pixels to NaN, or to the largest grey value."),
    assume_missing: bool = ASSUME_MISSING,
    kind: str | None = KIND,
    stated: ReadingOptions = STATED_IN_COLOUR,
    force: bool = option("Replace finished corrected images in OUT."),
    quiet: bool = QUIET,
) -> None:
    """Correct the images of SOURCE for response and vignette.

    SOURCE is a recording of any kind, a folder of images, a video, image files, or a pattern such as 'photos/*.jpg'.
    Exposures are needed only for --normalise-exposure. Colour images remain in colour, unless --channel selects one
    channel.

    CALIBRATION is a calibration.json or its folder, a pair 'pcalib.txt,vignette.png', a folder with these, or a file
    of hugin (.pto), Adobe (.lcp), lensfun (.xml) or OpenCV (.yml).

    OUT/images gets the corrected images under their own names, with their EXIF (PNG and JPEG) and file times. OUT
    also gets correction.json, which describes the correction, the original camera.txt if it is for images of the same
    size, and times.txt if stamps are known. With 8- and 16-bit images, it also gets a matching pcalib.txt and a
    constant vignette.png; if exposures are known, OUT is then itself a recording.

    Correct images before undistortion, rectification or scaling, never after it.
    """
    from ospc.correction.folder import CorrectedFolder
    from ospc.correction.recording import correct_recording
    from ospc.correction.source import open_source
    from ospc.formats.opening import open_photometry

    settings = CorrectionSettings(
        output=output,
        keep_response=keep_response,
        normalise_exposure=normalise_exposure,
        reference_ms=reference_ms,
        white=white,
        mask_saturated=mask_saturated,
        assume_missing=assume_missing,
    )
    source = open_source(sources, kind, replace(stated, channel=stated.channel or Channel.ALL))
    photometry = open_photometry(calibration, source.recording.size)
    folder = CorrectedFolder.at(out, source.recording.path, force=force)
    state = f"{out} is unfinished; the same command completes it"
    with leaving(state), progress_of("correcting", quiet=quiet) as step:
        result = correct_recording(source, photometry, folder, settings, step)
    if quiet:
        return
    if result.kept:
        say(f"{counted(result.kept, 'image')} from an interrupted run kept", err=True)
    warn_of_assumed(result.assumed)
    if result.skipped:
        reasons = "; ".join(result.reasons[:_REASONS_SHOWN])
        say(f"warning: {counted(result.skipped, 'frame')} skipped: {reasons}", err=True)
    say_notes(result.notes)
    say(f"{result.path / 'images'}: {counted(len(result.frames), 'image')}")
    say(f"each pixel is {result.formula}")
    share = f"{result.saturated:.2%} of the values were saturated"
    say(share + (f", {result.clipped:.2%} more are brighter than white" if result.clipped else ""))


def warn_of_assumed(parts: tuple[str, ...]) -> None:
    """Print on standard error which parts of a calibration are unknown and treated as the identity."""
    for part in parts:
        means = {"response": "linear", "vignette": "none"}[part]
        say(f"warning: the {part} is unknown and assumed to be {means}", err=True)
