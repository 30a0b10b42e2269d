"""The parameter files of the TUM monocular data set and of DSO: pcalib.txt, vignette.png, times.txt.

Both programs read them with fixed rules, part of them silent; what is written here passes them, and what is read
here is read as they would.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy.optimize

from ospc.arrays import Float32Array
from ospc.errors import ExposureError, FormatError, SettingError
from ospc.formats.files import read_text, write_text
from ospc.formats.png import read_png, write_png
from ospc.formats.scanning import leading_numbers
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette

FEWEST_VALUES = 256
"""Values DSO asks for at least, and the monocular data set's tools exactly."""

MOST_VALUES = 65536
"""Values DSO has room for."""

LARGEST_ID = 2**31 - 1
"""Largest frame id that ``%d`` is defined for."""

_SMALLEST_POSITIVE = np.float32(1e-30)


def strictly_increasing_float32(values: npt.ArrayLike) -> Float32Array:
    """Return the curve nearest to one from 0 to 255 that increases strictly as 32-bit floats.

    Where 32 bits cannot tell neighbours apart, they move by the least number of representable steps (least squares in
    such steps); everything else stays. Subnormal numbers are avoided, because some parsers refuse them.

    Parameters
    ----------
    values
        Shape (n,), non-decreasing from 0 to 255.
    """
    rounded = np.clip(np.asarray(values, dtype=np.float64), 0.0, 255.0).astype(np.float32)
    # non-negative floats sort like the integers with the same bits, and neighbours there are neighbours here
    index = np.arange(rounded.size)
    slack = scipy.optimize.isotonic_regression(rounded.view(np.int32) - index).x
    least, most = _SMALLEST_POSITIVE.view(np.int32) - 1, np.float32(255).view(np.int32) - index[-1]
    spread = np.round(np.clip(slack, least, most)).astype(np.int32) + index
    spread[0], spread[-1] = 0, np.float32(255).view(np.int32)
    return np.asarray(spread.astype(np.int32).view(np.float32))


def write_pcalib(response: Response, path: str | Path, values: int = FEWEST_VALUES) -> Path:
    """Write an inverse response as pcalib.txt, atomically, and return its path.

    One line of values from 0 to 255 with nine significant digits, strictly increasing as 32-bit floats.

    Parameters
    ----------
    response
        The response; its inverse is written.
    path
        Where to.
    values
        Number of grey levels: 256 for 8 bit; DSO's descendants for deeper images take up to 65536.

    Raises
    ------
    SettingError
        If no program reads that many values.
    FormatError
        If the file cannot be written.
    """
    if not FEWEST_VALUES <= values <= MOST_VALUES:
        raise SettingError(f"a pcalib.txt has {FEWEST_VALUES} to {MOST_VALUES} values, not {values}")
    table = strictly_increasing_float32(255 * response.resampled(values))
    return write_text(path, " ".join(f"{value:.9g}" for value in table) + "\n")


def read_pcalib(path: str | Path) -> Response:
    """Read the inverse response in a pcalib.txt as DSO would: its first line alone counts.

    Returns
    -------
    Response
        With one table entry a value; shifted and scaled to run from 0 to 1, so that a black level is lost as it is in
        DSO.

    Raises
    ------
    FormatError
        If there are fewer than 256 values or more than 65536, something else than numbers among them, or if they do
        not increase strictly as 32-bit floats.
    """
    first_line = read_text(path).split("\n", 1)[0]
    values, rest = leading_numbers(first_line)
    if rest:
        raise FormatError(
            f"{path}: value {values.size + 1} is {rest.split()[0][:20]!r}, not a number; "
            f"'ospc validate --repair' writes a mended copy"
        )
    if not FEWEST_VALUES <= values.size <= MOST_VALUES:
        raise FormatError(
            f"{path}: {values.size} values on the first line, expected {FEWEST_VALUES} to {MOST_VALUES}; "
            f"all values belong on the first line"
        )
    with np.errstate(over="ignore"):
        stored = values.astype(np.float32)
    if not np.all(np.isfinite(stored)):
        raise FormatError(f"{path}: holds values too large for 32 bits; scale them to 0..255")
    falls = np.flatnonzero(np.diff(stored) <= 0)
    if falls.size:
        raise FormatError(
            f"{path}: does not increase strictly after grey level {falls[0]} ({falls.size} such places); "
            f"'ospc validate --repair' writes a mended copy"
        )
    return Response.from_values(values, model={"name": "table", "source": Path(path).name})


def write_vignette(vignette: Vignette, path: str | Path) -> Path:
    """Write a vignette as a grey 16-bit PNG of its own size, atomically, and return the path.

    The largest attenuation becomes 65535. A value that would round to 0 becomes 1, for the programs divide by it.

    Raises
    ------
    FormatError
        If the vignette is negative or not finite somewhere, or the file cannot be written.
    """
    image = vignette.image().astype(np.float64)
    if not np.all(np.isfinite(image)) or image.min() < 0 or image.max() <= 0:
        raise FormatError(f"{path}: the vignette is negative or not finite in places and so is none")
    scaled = np.round(image / image.max() * 65535)
    return write_png(path, np.clip(scaled, 1, 65535).astype(np.uint16))


def read_vignette(path: str | Path) -> RasterVignette:
    """Read a vignette.png.

    Returns
    -------
    RasterVignette
        Divided by its maximum. Pixels that are 0, as around a fisheye's image circle, stay 0.

    Raises
    ------
    FormatError
        If it is no PNG, damaged, not grey, or black.
    """
    _, image = read_png(path)
    if image.ndim != 2:
        raise FormatError(
            f"{path}: has {image.shape[2]} channels, a vignette has one; 'ospc validate --repair' writes a grey copy"
        )
    if image.max() == 0:
        raise FormatError(f"{path}: is black all over and so no vignette")
    return RasterVignette(image.astype(np.float32), {"file": Path(path).name, "bits": image.dtype.itemsize * 8})


def write_times(path: str | Path, ids: Sequence[int], stamps_s: npt.ArrayLike, exposures_ms: npt.ArrayLike) -> Path:
    """Write times.txt, one line ``id stamp exposure`` an image, atomically, and return its path.

    Parameters
    ----------
    path
        Where to.
    ids
        Integers below 2³¹ that identify the images.
    stamps_s
        Time stamps in seconds, one an image; written to the nanosecond.
    exposures_ms
        Exposures in milliseconds, one an image, positive: a zero is DSO's sign for unknown.

    Raises
    ------
    FormatError
        If the three differ in length, an id is no such integer, a stamp is not finite, or the file cannot be written.
    ExposureError
        If an exposure is not a positive number.
    """
    stamps = np.asarray(stamps_s, dtype=np.float64)
    exposures = np.asarray(exposures_ms, dtype=np.float64)
    if not stamps.shape == exposures.shape == (len(ids),):
        raise FormatError(
            f"{path}: {len(ids)} ids, {stamps.size} stamps and {exposures.size} exposures; one of each an image"
        )
    if not all(isinstance(i, int | np.integer) and 0 <= i <= LARGEST_ID for i in ids):
        raise FormatError(f"{path}: ids must be integers from 0 to {LARGEST_ID}; number the images instead")
    if not np.all(np.isfinite(stamps)):
        raise FormatError(f"{path}: time stamps must be finite")
    with np.errstate(over="ignore", under="ignore"):
        stored = exposures.astype(np.float32)
    if not np.all(np.isfinite(stored) & (stored > 0)):
        raise ExposureError(f"{path}: exposures must be finite and positive, in milliseconds")
    lines = (f"{i:d} {s:.9f} {e:.9g}\n" for i, s, e in zip(ids, stamps, exposures, strict=True))
    return write_text(path, "".join(lines))
