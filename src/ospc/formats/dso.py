"""The parameter files of the TUM monocular data set and of DSO: pcalib.txt, vignette.png, times.txt.

Both programs have strict rules for these files and often fail silently. This module writes files that follow the
rules, and reads files as the programs do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ospc.errors import ExposureError, FormatError, SettingError
from ospc.formats.files import read_text, write_text
from ospc.formats.image_files import read_png, write_png
from ospc.formats.rules import Context
from ospc.formats.rules_pcalib import FEWEST_VALUES, MOST_VALUES, PCALIB, PcalibText, table_text
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette

CAVEAT = "EXPOSURES_UNKNOWN.txt"
"""File written next to a pcalib.txt that was estimated without exposures, because that format only has numbers."""

PARAMETER_FILES = ("pcalib.txt", "pcalib_16bit.txt", "vignette.png", CAVEAT)
"""Names of all files that :func:`parameter_files` may yield."""

LARGEST_ID = 2**31 - 1
"""Largest frame id that a 32-bit ``%d`` can read."""


def write_pcalib(response: Response, path: str | Path, values: int = FEWEST_VALUES) -> Path:
    """Write an inverse response as pcalib.txt, atomically, and return its path.

    The file has one line of values from 0 to 255 with nine significant digits, strictly increasing as 32-bit floats.
    ``values`` is the number of grey levels: 256 for 8 bits; descendants of DSO for deeper images accept up to 65536.

    Raises
    ------
    SettingError
        If no program accepts this number of values.
    FormatError
        If the file cannot be written.
    """
    if not FEWEST_VALUES <= values <= MOST_VALUES:
        raise SettingError(f"a pcalib.txt has {FEWEST_VALUES} to {MOST_VALUES} values, not {values}")
    return write_text(path, table_text(response.resampled(values)))


def read_pcalib(path: str | Path) -> Response:
    """Read the inverse response in a pcalib.txt as DSO does, from the first line only.

    The response has one table entry per value, shifted and scaled to the range from 0 to 1. This loses a black level,
    as in DSO. A byte order mark is skipped.

    Raises
    ------
    FormatError
        If DSO would reject the rest of the file; ``validate`` then finds an error.
    """
    place = Path(path)
    table = PcalibText(read_text(place))
    for finding in PCALIB.findings_in(table, place, Context("dso")):
        if finding.severity == "error":
            raise FormatError(f"{place}: {'; '.join(filter(None, (finding.rule, finding.remedy)))}")
    return Response.from_values(table.scanned[0], model={"name": "table", "source": place.name})


def write_vignette(vignette: Vignette, path: str | Path, description: str = "") -> Path:
    """Write a vignette as a grey 16-bit PNG of its own size, atomically, and return the path.

    The largest value becomes 65535. A value that would round to 0 becomes 1, because the programs divide by it.
    ``description`` is stored in the PNG as text.

    Raises
    ------
    FormatError
        If the vignette has negative or non-finite values, or the file cannot be written.
    """
    image = vignette.image().astype(np.float64)
    if not np.all(np.isfinite(image)) or image.min() < 0 or image.max() <= 0:
        raise FormatError(f"{path}: the vignette is negative or not finite in some places")
    scaled = np.round(image / image.max() * 65535)
    return write_png(path, np.clip(scaled, 1, 65535).astype(np.uint16), description)


def read_vignette(path: str | Path) -> RasterVignette:
    """Read a vignette.png and divide it by its maximum.

    Pixels that are 0, as outside the image circle of a fisheye, stay 0.

    Raises
    ------
    FormatError
        If the file is not a PNG, or the image is damaged, not grey, or black.
    """
    image = read_png(path)
    if image.ndim != 2:
        raise FormatError(
            f"{path}: has {image.shape[2]} channels instead of one; 'ospc validate --repair' writes a grey copy"
        )
    if image.max() == 0:
        raise FormatError(f"{path}: is entirely black, so it is not a vignette; calibrate again")
    return RasterVignette(image.astype(np.float32), {"file": Path(path).name, "bits": image.dtype.itemsize * 8})


def parameter_files(
    response: Response | None,
    vignette: Vignette | None,
    max_grey: int,
    caveat: str = "",
    values: int = FEWEST_VALUES,
) -> Iterator[tuple[str, Callable[[Path], Path]]]:
    """Yield name and writer of the files for the known parts, including pcalib_16bit.txt for images of more bits.

    pcalib_16bit.txt has a value for every grey level of 16 bits, because conversions for these programs left-align
    images of 10 or 12 bits in 16. ``caveat`` is a sentence to include with the files, and ``values`` the number of
    grey levels in pcalib.txt.
    """
    if caveat:
        about = f"{caveat}.\nThis applies to pcalib.txt, vignette.png and times.txt in this folder.\n"
        yield CAVEAT, lambda place: write_text(place, about)
    if response is not None:
        yield "pcalib.txt", lambda place: write_pcalib(response, place, values)
    if response is not None and max_grey > 255:
        yield "pcalib_16bit.txt", lambda place: write_pcalib(response, place, MOST_VALUES)
    if vignette is not None:
        yield "vignette.png", lambda place: write_vignette(vignette, place, caveat)


def read_caveat(folder: str | Path) -> str:
    """Return the caveat of the parameter files in a folder; empty if there is none.

    Raises
    ------
    FormatError
        If there is one that cannot be read.
    """
    place = Path(folder) / CAVEAT
    return read_text(place).partition("\n")[0].strip().removesuffix(".") if place.is_file() else ""


def write_times(
    path: str | Path, ids: Sequence[int], stamps_s: npt.ArrayLike, exposures_ms: npt.ArrayLike | None
) -> Path:
    """Write times.txt with a line ``id stamp exposure`` per image, atomically, and return its path.

    Ids are integers below 2³¹; time stamps are rounded to nanoseconds. If exposures are None, there is no column for
    them.

    Raises
    ------
    FormatError
        If the lengths differ, an id is not such an integer, a stamp is not finite, or the file cannot be written.
    ExposureError
        If an exposure is not a positive number: DSO treats zero as unknown.
    """
    stamps = np.asarray(stamps_s, dtype=np.float64)
    exposures = np.ones(stamps.shape) if exposures_ms is None else np.asarray(exposures_ms, dtype=np.float64)
    if not stamps.shape == exposures.shape == (len(ids),):
        raise FormatError(
            f"{path}: {len(ids)} ids, {stamps.size} stamps and {exposures.size} exposures; each image needs all three"
        )
    if not all(isinstance(i, int | np.integer) and 0 <= i <= LARGEST_ID for i in ids):
        raise FormatError(f"{path}: ids must be integers from 0 to {LARGEST_ID}; number the images instead")
    if not np.all(np.isfinite(stamps)):
        raise FormatError(f"{path}: time stamps must be finite")
    with np.errstate(over="ignore", under="ignore"):
        stored = exposures.astype(np.float32)
    if not np.all(np.isfinite(stored) & (stored > 0)):
        raise ExposureError(f"{path}: exposures must be known, finite and positive, in milliseconds")
    lines = (
        f"{i:d} {s:.9f}\n" if exposures_ms is None else f"{i:d} {s:.9f} {e:.9g}\n"
        for i, s, e in zip(ids, stamps, exposures, strict=True)
    )
    return write_text(path, "".join(lines))
