"""``ospc export``: write a calibration for another program."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click

from ospc.cli.calibration_report import say_notes
from ospc.cli.options import PATH, SIZE, out_option
from ospc.cli.terminal import say


def _parse_crop(_ctx: click.Context, _param: click.Parameter, value: str | None) -> tuple[int, int, int, int] | None:
    if value is None:
        return None
    match = re.fullmatch(r"(\d{1,6}),(\d{1,6}),([1-9]\d{0,5})[x×]([1-9]\d{0,5})", value)
    if match is None:
        raise click.BadParameter(f"{value!r} is no crop; write X,Y,WIDTHxHEIGHT, such as 64,32,1024x768")
    x, y, width, height = (int(group) for group in match.groups())
    return x, y, width, height


@click.command("export")
@click.argument("calibration")
@click.option(
    "--to",
    "program",
    type=click.Choice(["dso", "lensfun", "hugin", "opencv", "adobe", "json"]),
    required=True,
    help="Program that will read it.",
)
@out_option(folder=False, help="File to write; a folder for dso.")
@click.option("--crop", metavar="X,Y,WxH", callback=_parse_crop, help="For images cropped to this part.")
@click.option(
    "--bin",
    "binning",
    metavar="N",
    type=click.IntRange(min=1),
    default=1,
    help="For images binned by averaging blocks of NxN pixels, after the crop.",
)
@click.option("--size", metavar="WxH", type=SIZE, help="For images scaled to this size, after the crop.")
@click.option("--values", default=256, help="Grey levels in pcalib.txt (dso).")
@click.option("--focal-px", type=float, help="Focal length in pixels (adobe, lensfun).")
@click.option("--focal-mm", type=float, help="Focal length in millimetres (adobe, lensfun).")
@click.option("--crop-factor", type=float, help="Diagonal of 36x24 mm over the sensor's (adobe, lensfun).")
@click.option("--aperture", type=float, help="f-number (adobe, lensfun).")
@click.option("--maker", default="unknown", help="Maker of the lens (adobe, lensfun).")
@click.option("--lens", default="unknown", help="Name of the lens (adobe, lensfun).")
@click.option("--camera", default="unknown", help="Name of the camera (adobe).")
@click.option(
    "--lensfun-model",
    type=click.Choice(["pa", "acm"]),
    default="pa",
    help="Radius in half diagonals or in focal lengths (lensfun).",
)
@click.option("--emor", type=PATH, help="The base curves emor.txt, to write the response (hugin).")
def command(
    *,
    calibration: str,
    program: Any,
    out: Path,
    crop: tuple[int, int, int, int] | None,
    binning: int,
    size: tuple[int, int] | None,
    values: int,
    emor: Path | None,
    lensfun_model: Any,
    **optics: Any,
) -> None:
    """Write CALIBRATION for another program.

    CALIBRATION is a calibration.json or its folder, a pcalib.txt, a vignette.png, a pair 'pcalib.txt,vignette.png',
    or a file of hugin (.pto), Adobe (.lcp) or OpenCV (.yml). Writes pcalib.txt and vignette.png (dso), a database
    file (lensfun, .xml), a project for use as a template (hugin, .pto), a file storage (opencv, .yml), a lens profile
    (adobe, .lcp), or calibration.json. Reports what the format cannot hold, and the residuals of fits.
    """
    from ospc.formats.export import ExportSettings, adapted, export
    from ospc.formats.hugin import read_emor
    from ospc.formats.opening import open_photometry
    from ospc.formats.radial import Optics

    settings = ExportSettings(
        optics=Optics(**optics),
        lensfun_model=lensfun_model,
        emor=None if emor is None else read_emor(emor),
        values=values,
    )
    written = export(adapted(open_photometry(calibration), crop, size, binning), program, out, settings)
    for path in written.files:
        say(f"wrote {path}")
    say_notes(written.notes)
