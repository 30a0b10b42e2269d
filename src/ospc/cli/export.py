"""``ospc export``: write a calibration for another program."""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path

import click

from ospc.cli.options import SIZE, Parsed, argument, declared, option, out_option
from ospc.cli.terminal import say, say_notes
from ospc.formats.export import Program, adapted, export, files_of
from ospc.formats.opening import open_photometry
from ospc.formats.radial import Optics
from ospc.recording.derived import Region
from ospc.system.folders import check_new


@declared("export")
def command(
    *,
    calibration: str = argument(),
    program: Program = option(
        "Program that will read it.",
        "--to",
        type=click.Choice(["dso", "lensfun", "hugin", "opencv", "adobe", "json"]),
        required=True,
    ),
    out: Path = out_option("File to write; a folder for dso.", folder=False),
    force: bool = option("Replace files that exist."),
    crop: Region | None = option(
        "For images cropped to this region.", metavar="X,Y,W,H", type=Parsed("region", Region.parse)
    ),
    size: tuple[int, int] | None = option(
        "For images scaled to this size, after the crop.", metavar="WxH", type=SIZE
    ),
    values: int = option("Grey levels in pcalib.txt (dso).", default=256),
    focal_px: float | None = option("Focal length in pixels (adobe, lensfun)."),
    focal_mm: float | None = option("Focal length in millimetres (adobe, lensfun)."),
    crop_factor: float | None = option("Diagonal of 36x24 mm divided by that of the sensor (adobe, lensfun)."),
    aperture: float | None = option("f-number (adobe, lensfun)."),
    maker: str = option("Manufacturer of the lens (adobe, lensfun).", default="unknown"),
    lens: str = option("Name of the lens (adobe, lensfun).", default="unknown"),
    camera: str = option("Name of the camera (adobe).", default="unknown"),
) -> None:
    """Write CALIBRATION for another program.

    CALIBRATION is a calibration.json or its folder, a pcalib.txt, a vignette.png, a pair 'pcalib.txt,vignette.png',
    or a file of hugin (.pto), Adobe (.lcp) or OpenCV (.yml). Writes pcalib.txt and vignette.png (dso), a database
    file (lensfun, .xml), a project for use as a template (hugin, .pto), a file storage (opencv, .yml), a lens profile
    (adobe, .lcp), or calibration.json. Reports what the format cannot represent, and the residuals of fits.
    """
    check_new(files_of(program, out), force=force)
    optics = Optics(focal_mm, focal_px, crop_factor, aperture, maker=maker, lens=lens, camera=camera)
    part = None if crop is None else astuple(crop)
    written = export(adapted(open_photometry(calibration), part, size), program, out, optics, values)
    for path in written.files:
        say(f"wrote {path}")
    say_notes(written.notes)
