"""``ospc import``: turn a response and a vignette from other programs into a calibration.json."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.validate import parse_size

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry
    from ospc.photometry.calibration import Calibration, Verdict


@click.command("import")
@click.argument("pcalib")
@click.argument("vignette", required=False)
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="calibration.json to write.")
@click.option("--size", metavar="WxH", callback=parse_size, help="Size of the images, if no file states it.")
@click.option(
    "--max-grey",
    type=click.IntRange(1, 65535),
    help="Largest grey value of the images; by default that of the response table, 255 for 256 values.",
)
def command(pcalib: str, vignette: str | None, out: Path, size: tuple[int, int] | None, max_grey: int | None) -> None:
    """Write PCALIB and VIGNETTE as a calibration.json.

    PCALIB is a pcalib.txt and VIGNETTE a vignette.png. Each may also be a file of hugin (.pto), Adobe (.lcp), lensfun
    (.xml) or OpenCV (.yml), and one folder or file with both parts is enough. 'ospc export --to dso' gives the same
    pcalib.txt and vignette.png back.
    """
    from ospc.errors import SettingError
    from ospc.formats.opening import open_photometry, together

    sources = [pcalib] if vignette is None else [pcalib, vignette]
    if out.resolve() in [Path(source).resolve() for source in sources]:
        raise SettingError(f"{out}: is one of the files to import; choose another name")
    first, *others = (open_photometry(source, size) for source in sources)
    calibration = _calibration(together(first, others[0]) if others else first, size, max_grey)
    place = calibration.save(out)
    width, height = calibration.size
    click.echo(f"wrote {place}: images of {width}x{height} pixels, grey values up to {calibration.max_grey}")
    for part, verdict in calibration.verdicts.items():
        click.echo(f"{part}: {verdict.reason}" + (f"; {verdict.remedy}" if verdict.remedy else ""))


def _calibration(photometry: Photometry, size: tuple[int, int] | None, max_grey: int | None) -> Calibration:
    from dataclasses import replace

    from ospc.errors import FormatError, SettingError
    from ospc.photometry.calibration import Calibration

    response, vignette = photometry.response, photometry.vignette
    if response is None and vignette is None:
        raise FormatError(f"{photometry.name}: holds neither response nor vignette")
    known = photometry.size
    if known is not None and size not in (None, known):
        raise SettingError(
            f"{photometry.name}: is for images of {known[0]}x{known[1]} pixels; leave out --size, then scale "
            f"the result with 'ospc export --size'"
        )
    if known is None and size is None:
        raise SettingError(f"{photometry.name}: does not state the image size; add the vignette, or --size")
    if photometry.calibration is not None:
        return replace(photometry.calibration, max_grey=max_grey or photometry.calibration.max_grey)
    # A pcalib.txt for deeper images has one value per grey level: 10, 12, 14 or 16 bits.
    values = 256 if response is None else response.inverse_table.size
    greys = values - 1 if values in (1024, 4096, 16384, 65536) else 255
    return Calibration(
        known or size or (0, 0),
        response,
        vignette,
        {part: _verdict(part, photometry) for part in ("response", "vignette")},
        max_grey=max_grey or greys,
        source={"imported_from": photometry.name},
    )


def _verdict(part: str, photometry: Photometry) -> Verdict:
    from ospc.photometry.calibration import Verdict

    if getattr(photometry, part) is None:
        return Verdict("not identifiable", f"{photometry.name} does not hold it", "calibrate from a recording")
    return Verdict("identifiable", f"imported from {photometry.name}, which states no uncertainty")
