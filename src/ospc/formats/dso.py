"""The parameter files of the TUM monocular data set and of DSO: pcalib.txt, vignette.png, times.txt.

Both programs have strict rules for them and often fail silently. Files written here keep the rules, and files
read here mean what the programs take them to mean.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ospc.errors import ExposureError, FormatError, SettingError
from ospc.formats.files import read_text, write_text
from ospc.formats.png import read_png, write_png
from ospc.formats.rules import Context
from ospc.formats.rules_pcalib import FEWEST_VALUES, MOST_VALUES, PCALIB, PcalibText, table_text
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette

CAVEAT = "EXPOSURES_UNKNOWN.txt"
"""Stands beside a pcalib.txt that was made without exposures; that format holds nothing but numbers."""

LARGEST_ID = 2**31 - 1
"""Largest frame id that a 32-bit ``%d`` holds."""


def write_pcalib(response: Response, path: str | Path, values: int = FEWEST_VALUES) -> Path:
    """Write an inverse response as pcalib.txt, atomically, and return its path.

    One line of values from 0 to 255 with nine significant digits, strictly increasing as 32-bit floats. ``values`` is
    the number of grey levels: 256 for 8 bit; DSO's descendants for deeper images take up to 65536. SettingError if no
    program reads that many; FormatError if the file cannot be written.
    """
    if not FEWEST_VALUES <= values <= MOST_VALUES:
        raise SettingError(f"a pcalib.txt has {FEWEST_VALUES} to {MOST_VALUES} values, not {values}")
    return write_text(path, table_text(response.resampled(values)))


def read_pcalib(path: str | Path) -> Response:
    """Read the inverse response in a pcalib.txt as DSO does: only the first line counts.

    The response has one table entry per value, shifted and scaled to run from 0 to 1; like DSO, this loses a black
    level. A byte order mark is skipped. FormatError if DSO would refuse the rest of the file: ``validate`` finds an
    error in it.
    """
    place = Path(path)
    table = PcalibText(read_text(place))
    for finding in PCALIB.findings_in(table, place, Context("dso")):
        if finding.severity == "error":
            raise FormatError(f"{place}: {'; '.join(filter(None, (finding.rule, finding.remedy)))}")
    return Response.from_values(table.scanned[0], model={"name": "table", "source": place.name})


def write_vignette(vignette: Vignette, path: str | Path, description: str = "") -> Path:
    """Write a vignette as a grey 16-bit PNG of its own size, atomically, and return the path.

    The largest value becomes 65535. A value that would round to 0 becomes 1, because the programs divide by it. A
    ``description`` is stored in the PNG as text. FormatError if the vignette is negative or not finite somewhere,
    or the file cannot be written.
    """
    image = vignette.image().astype(np.float64)
    if not np.all(np.isfinite(image)) or image.min() < 0 or image.max() <= 0:
        raise FormatError(f"{path}: the vignette is negative or not finite in places")
    scaled = np.round(image / image.max() * 65535)
    return write_png(path, np.clip(scaled, 1, 65535).astype(np.uint16), description)


def read_vignette(path: str | Path) -> RasterVignette:
    """Read a vignette.png, divided by its maximum; FormatError if it is not a PNG, damaged, not grey, or black.

    Pixels that are 0, as around a fisheye's image circle, stay 0.
    """
    image = read_png(path)
    if image.ndim != 2:
        raise FormatError(
            f"{path}: has {image.shape[2]} channels, a vignette has one; 'ospc validate --repair' writes a grey copy"
        )
    if image.max() == 0:
        raise FormatError(f"{path}: is black all over, so it is no vignette; calibrate again")
    return RasterVignette(image.astype(np.float32), {"file": Path(path).name, "bits": image.dtype.itemsize * 8})


def parameter_files(
    response: Response | None,
    vignette: Vignette | None,
    max_grey: int,
    caveat: str = "",
    values: int = FEWEST_VALUES,
) -> Iterator[tuple[str, Callable[[Path], Path]]]:
    """Yield the names of the files for what is known, with pcalib_16bit.txt for deep images, and what writes them.

    ``caveat`` is a sentence to know of them, and ``values`` the number of grey levels in pcalib.txt.
    """
    if caveat:
        about = f"{caveat}.\nThis holds for pcalib.txt, vignette.png and times.txt in this folder.\n"
        yield CAVEAT, lambda place: write_text(place, about)
    if response is not None:
        yield "pcalib.txt", lambda place: write_pcalib(response, place, values)
    if response is not None and max_grey > 255:
        yield "pcalib_16bit.txt", lambda place: write_pcalib(response, place, min(max_grey + 1, MOST_VALUES))
    if vignette is not None:
        yield "vignette.png", lambda place: write_vignette(vignette, place, caveat)


def write_times(
    path: str | Path, ids: Sequence[int], stamps_s: npt.ArrayLike, exposures_ms: npt.ArrayLike | None
) -> Path:
    """Write times.txt, one line ``id stamp exposure`` per image, atomically, and return its path.

    Ids are integers below 2³¹; time stamps are written to the nanosecond. Unknown exposures, None, have no column.

    Raises
    ------
    FormatError
        If the three differ in length, an id is not such an integer, a stamp is not finite, or the file cannot be
        written.
    ExposureError
        If an exposure is not a positive number: zero means unknown to DSO.
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
