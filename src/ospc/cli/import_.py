"""``ospc import``: turn a response and a vignette from other programs into a calibration.json."""

from __future__ import annotations

from pathlib import Path

import click

from ospc.cli.options import IMAGE_SIZE, argument, declared, option, out_option
from ospc.cli.terminal import say
from ospc.system.folders import check_new


@declared("import")
def command(
    *,
    pcalib: str = argument(),
    vignette: str | None = argument(required=False),
    out: Path = out_option("calibration.json to write.", folder=False),
    force: bool = option("Replace OUT if it exists."),
    size: tuple[int, int] | None = IMAGE_SIZE,
    max_grey: int | None = option(
        "Largest grey value of the images; by default that of the response table, 255 for 256 values.",
        type=click.IntRange(1, 65535),
    ),
) -> None:
    """Convert PCALIB and VIGNETTE to a calibration.json.

    PCALIB is a pcalib.txt and VIGNETTE a vignette.png. Each may also be a file of hugin (.pto), Adobe (.lcp), lensfun
    (.xml) or OpenCV (.yml). A single folder or file with both parts is enough. 'ospc export --to dso' writes the same
    pcalib.txt and vignette.png again.
    """
    from ospc.errors import SettingError
    from ospc.formats.export import as_calibration, files_of
    from ospc.formats.opening import open_photometry, together

    sources = [pcalib] if vignette is None else [pcalib, vignette]
    if out.resolve() in [Path(source).resolve() for source in sources]:
        raise SettingError(f"{out}: is one of the files to import; choose another output file")
    check_new(files_of("json", out), force=force)
    first, *others = (open_photometry(source, size) for source in sources)
    calibration = as_calibration(together(first, others[0]) if others else first, size, max_grey)
    place = calibration.save(out)
    width, height = calibration.size
    say(f"wrote {place}: images of {width}x{height} pixels, grey values up to {calibration.max_grey}")
    for part, verdict in calibration.verdicts.items():
        say(f"{part}: {verdict.reason}" + (f"; {verdict.remedy}" if verdict.remedy else ""))
    if calibration.caveat:
        say(calibration.caveat)
