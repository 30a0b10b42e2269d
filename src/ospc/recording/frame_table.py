"""Lists of frames: which exposure and time stamp belong to which image."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, RecordingError, listed, quoted
from ospc.recording.exposure_units import EXPOSURE_RANGE_MS
from ospc.recording.image_names import by_name, is_image_name

LARGEST_STAMP = 1e20
"""Larger numbers are not time stamps in any unit."""

_EPOCH_UNITS = ((1e17, 1e-9, "nanoseconds"), (1e14, 1e-6, "microseconds"), (1e11, 1e-3, "milliseconds"))
"""Least value, scale and name of units of time stamps since 1970: 1e11 s would be the year 5138."""

_INTEGER = re.compile(r"\d{1,30}", re.ASCII)
"""Numbers of images; Python refuses to convert numbers that are much longer."""


class Row(NamedTuple):
    """One line of a list of frames.

    Attributes
    ----------
    line
        Line number, for messages.
    image
        Name of the image in the list; empty if it is not named.
    stamp_s
        Time stamp in seconds.
    exposure_ms
        Exposure in milliseconds.
    """

    line: int
    image: str
    stamp_s: float
    exposure_ms: float


@dataclass(frozen=True, eq=False)
class FrameTable:
    """A checked list of frames.

    Attributes
    ----------
    source
        The file, for messages.
    ids
        Names of the images in the list; empty if they are not named.
    stamps_s
        Time stamps in seconds, strictly increasing, shape (frames,).
    exposures_ms
        Exposures in milliseconds, finite and positive, shape (frames,).
    notes
        What was inferred.
    stamped
        Whether the list has time stamps; otherwise the frames are numbered, one per second.
    """

    source: str
    ids: tuple[str, ...]
    stamps_s: FloatArray
    exposures_ms: FloatArray
    notes: tuple[str, ...] = ()
    stamped: bool = True

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.exposures_ms)


def make_table(source: str, rows: Sequence[Row], notes: Sequence[str] = (), *, stamped: bool = True) -> FrameTable:
    """Check the rows of a list of frames and make a table of them.

    Parameters
    ----------
    source
        The file, for messages.
    rows
        One per frame, in temporal order; either all name their image or none does. Stamps too large for seconds are
        converted from the unit that fits.
    notes
        What was inferred so far.
    stamped
        Whether the stamps come from the file.

    Raises
    ------
    ExposureError
        If an exposure is not finite and positive.
    RecordingError
        If stamps do not increase or an image is named twice.
    """
    if not rows:
        raise RecordingError(f"{source}: holds no frames; it needs one line per image")
    _check_exposures(source, rows)
    _check_stamps(source, rows)
    ids = tuple(row.image for row in rows if row.image)
    _check_ids(source, rows)
    stamps = np.array([row.stamp_s for row in rows], dtype=np.float64)
    exposures = np.array([row.exposure_ms for row in rows], dtype=np.float64)
    said = list(notes)
    for least, scale, unit in _EPOCH_UNITS:
        if stamps[0] >= least:
            stamps *= scale
            said.append(f"{source}: time stamps are taken as {unit}, by their size")
            break
    stamps.setflags(write=False)
    exposures.setflags(write=False)
    return FrameTable(source, ids, stamps, exposures, tuple(said), stamped)


def table_or_unlisted(read: Callable[[], FrameTable], source: str, frames: int, *, allowed: bool) -> FrameTable:
    """Return the listed frames, or frames of 1 ms each if their exposures are missing or unusable.

    Parameters
    ----------
    read
        Reads the list; raises ExposureError if that fails.
    source
        Where the images are, for messages.
    frames
        Number of images.
    allowed
        Whether frames without known exposures are accepted.

    Raises
    ------
    ExposureError
        If there are no usable exposures and that is not allowed.
    """
    try:
        return read()
    except ExposureError:
        if not allowed or not frames:
            raise
    return unlisted(source, np.arange(frames, dtype=np.float64), stamped=False)


def unlisted(source: str, stamps_s: FloatArray, *, stamped: bool) -> FrameTable:
    """Return frames with unknown exposures, 1 ms each."""
    ones = np.ones(len(stamps_s))
    ones.setflags(write=False)
    return FrameTable(source, (), stamps_s, ones, (f"{source}: holds no usable exposures",), stamped)


def _check_exposures(source: str, rows: Sequence[Row]) -> None:
    low, high = EXPOSURE_RANGE_MS
    bad = [row for row in rows if not low <= row.exposure_ms <= high]
    if bad:
        plural = "lines" if len(bad) > 1 else "line"
        raise ExposureError(
            f"{source}, {plural} {listed([row.line for row in bad])}: the exposure must be a positive number of "
            f"milliseconds, not {bad[0].exposure_ms:g}; remove the frame or give its exposure"
        )


def _check_stamps(source: str, rows: Sequence[Row]) -> None:
    for row in rows:
        if not abs(row.stamp_s) < LARGEST_STAMP:
            raise RecordingError(f"{source}, line {row.line}: {row.stamp_s:g} is not a time stamp; correct the line")
    for before, after in pairwise(rows):
        if after.stamp_s <= before.stamp_s:
            how = "the same time stamp" if before.stamp_s == after.stamp_s else "time goes back"
            raise RecordingError(
                f"{source}, lines {before.line} and {after.line}: {how}; frames must be in the order they were taken"
            )


def _check_ids(source: str, rows: Sequence[Row]) -> None:
    first: dict[str, int] = {}
    for row in rows:
        if row.image and first.setdefault(row.image, row.line) != row.line:
            raise RecordingError(
                f"{source}, lines {first[row.image]} and {row.line}: both name the image {quoted(row.image)}; "
                f"remove one of them"
            )


def match_images(table: FrameTable, names: Sequence[str], place: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Find the image of every row of a table.

    An image belongs to the row with its name, its name without suffix, or its number. If rows and images are both
    numbered without gaps, but from different numbers, they correspond by order.

    Parameters
    ----------
    table
        The frames.
    names
        File names of the images, sorted.
    place
        Where the images are, for messages.

    Returns
    -------
    tuple[tuple[str, ...], tuple[str, ...]]
        Name of the image of every row, and notes.

    Raises
    ------
    RecordingError
        If rows and images do not correspond.
    """
    if not table.ids:
        if len(table) != len(names):
            raise _mismatch(table, names, place, "")
        return tuple(names), (f"{table.source}: names no images; they are matched in the order of their names",)
    by_key = _by_key(names, place)
    found = [by_key.get(image) or by_key.get(_number(image)) for image in table.ids]
    missing = [image for image, name in zip(table.ids, found, strict=True) if name is None]
    unused = sorted(set(names) - set(found), key=by_name)
    if len(table) == len(names):
        if not missing and not unused:
            return tuple(name for name in found if name is not None), ()
        none_match = len(missing) == len(table) and not any(is_image_name(image) for image in table.ids)
        if none_match or _counted(table.ids, names):
            return tuple(names), (f"{table.source}: its ids are not names of images; they are matched by order",)
    detail = f"; no image for {listed(missing)}" if missing else ""
    detail += f"; no line for {listed(unused)}" if unused else ""
    raise _mismatch(table, names, place, detail)


def _mismatch(table: FrameTable, names: Sequence[str], place: str, detail: str) -> RecordingError:
    same = "other images than the" if len(table) == len(names) else f"{len(table)} frames but there are"
    return RecordingError(
        f"{table.source}: lists {same} {len(names)} images in {place}{detail}; there must be one line per image"
    )


def _number(text: str) -> str:
    """Return a key that is the same for 7, 07 and 00007 and differs from all file names."""
    return f"/{int(text)}" if _INTEGER.fullmatch(text) else ""


def _by_key(names: Sequence[str], place: str) -> dict[str, str]:
    """Return the images by all the keys that may name them; refuse keys of two images."""
    keys: dict[str, str] = {}
    for name in names:
        path = PurePosixPath(name)
        for key in {name, path.name, path.stem, _number(path.stem)} - {""}:
            if keys.setdefault(key, name) != name:
                raise RecordingError(
                    f"{place}: {quoted(keys[key])} and {quoted(name)} cannot be told apart by their names; "
                    f"rename one of them"
                )
    return keys


def _counted(ids: Sequence[str], names: Sequence[str]) -> bool:
    """Tell whether rows and images are both numbered without gaps."""
    stems = [PurePosixPath(name).stem for name in names]
    return all(_consecutive(texts) for texts in (ids, stems))


def _consecutive(texts: Sequence[str]) -> bool:
    if not all(_INTEGER.fullmatch(text) for text in texts):
        return False
    numbers = [int(text) for text in texts]
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))
