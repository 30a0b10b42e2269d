"""Tables of frames with their exposures, time stamps and images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, read_only
from ospc.errors import ExposureError, MissingExtraError, RecordingError, listed, plain, quoted
from ospc.photometry.correction import EXPOSURE_RANGE_MS

_LARGEST_STAMP = 1e20
"""Largest time stamp in any unit."""

Where = Callable[[Sequence[int]], str]
"""Names frames in messages, given their indices."""


@dataclass(frozen=True, eq=False)
class FrameTable:
    """A checked table of frames from the file ``source``; stamps increase, and exposures are finite and positive.

    Both have shape (frames,); unknown exposures are NaN. ``ids`` are the image names in the file, empty if it has
    none. ``notes`` state what was inferred. ``stamped`` is whether the file has time stamps; otherwise the frames are
    numbered, one per second.
    """

    source: str
    ids: tuple[str, ...]
    stamps_s: FloatArray
    exposures_ms: FloatArray
    notes: tuple[str, ...] = ()
    stamped: bool = True

    def __len__(self) -> int:
        return len(self.exposures_ms)


def make_table(
    source: str,
    ids: Sequence[str],
    stamps_s: npt.ArrayLike,
    exposures_ms: npt.ArrayLike,
    notes: Sequence[str] = (),
    *,
    lines: Sequence[int] = (),
    stamped: bool = True,
) -> FrameTable:
    """Return a checked table of frames in temporal order.

    ``lines`` are the line numbers of the frames, for messages; without them, messages name the images.

    Raises
    ------
    ExposureError
        As for :func:`checked_exposures`.
    RecordingError
        If there are no frames, stamps do not increase, or an image is named twice.
    """
    if not len(np.atleast_1d(exposures_ms)):
        raise RecordingError(f"{source}: has no frames; it needs one line per image")

    def where(frames: Sequence[int]) -> str:
        if lines:
            return at_lines(source, [lines[i] for i in frames])
        return f"{source}, {listed([ids[i] for i in frames])}"

    first: dict[str, int] = {}
    for index, image in enumerate(ids):
        if first.setdefault(image, index) != index:
            raise RecordingError(f"{where([first[image], index])}: both name the image {quoted(image)}; remove one")
    exposures = checked_exposures(exposures_ms, where)
    return FrameTable(source, tuple(ids), checked_stamps(stamps_s, where), exposures, tuple(notes), stamped)


def at_lines(source: str, numbers: Sequence[int]) -> str:
    """Return the place of lines in a file, for messages."""
    return f"{source}, {'lines' if len(numbers) > 1 else 'line'} {listed(numbers)}"


def checked_exposures(
    exposures_ms: npt.ArrayLike,
    where: Where,
    remedy: str = "remove the frame or give its exposure, nan if it is unknown",
) -> FloatArray:
    """Return a read-only copy of exposures; unknown ones are NaN.

    Raises
    ------
    ExposureError
        If an exposure is not finite and positive, or all are unknown.
    """
    exposures = np.array(exposures_ms, dtype=np.float64)
    low, high = EXPOSURE_RANGE_MS
    unknown = np.isnan(exposures)
    bad = np.flatnonzero(~((exposures >= low) & (exposures <= high) | unknown))
    if bad.size:
        limit = f" and at most {plain(high)}" if exposures[bad[0]] > high else ""
        raise ExposureError(
            f"{where(bad.tolist())}: the exposure must be a positive number of milliseconds{limit}, not "
            f"{plain(exposures[bad[0]], 6)}; {remedy}"
        )
    if unknown.all():
        raise ExposureError(f"{where(np.flatnonzero(unknown).tolist())}: no exposure is known; {remedy}")
    return read_only(exposures)


def checked_stamps(stamps_s: npt.ArrayLike, where: Where) -> FloatArray:
    """Return a read-only copy of time stamps; RecordingError if they are not finite or do not increase."""
    stamps = np.array(stamps_s, dtype=np.float64)
    bad = np.flatnonzero(~(np.abs(stamps) < _LARGEST_STAMP))
    if bad.size:
        raise RecordingError(f"{where(bad.tolist()[:1])}: {stamps[bad[0]]:g} is not a time stamp; correct it")
    wrong = np.flatnonzero(np.diff(stamps) <= 0)
    if wrong.size:
        before = int(wrong[0])
        how = "the same time stamp" if stamps[before] == stamps[before + 1] else "time goes back"
        raise RecordingError(f"{where([before, before + 1])}: {how}; frames must be in the order they were taken")
    return read_only(stamps)


def table_or_placeholder(
    read: Callable[[], FrameTable], source: str, count: Callable[[], int], *, allowed: bool
) -> FrameTable:
    """Return the table from ``read``, or if ``allowed``, :func:`placeholder_table` if no exposures can be read."""
    try:
        return read()
    except (ExposureError, MissingExtraError):
        if not allowed or not (frames := count()):
            raise
    return placeholder_table(source, np.arange(frames, dtype=np.float64), stamped=False)


NO_EXPOSURES = "has no usable exposures"
NO_STAMPS = "has no time stamps; frames are numbered, one per second"
"""Endings of notes on unknown exposures or times."""


def placeholder_table(source: str, stamps_s: FloatArray, *, stamped: bool) -> FrameTable:
    """Return frames with unknown exposures, 1 ms each."""
    ones = read_only(np.ones(len(stamps_s)))
    return FrameTable(source, (), stamps_s, ones, (f"{source}: {NO_EXPOSURES}",), stamped)
