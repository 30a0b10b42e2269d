"""Tables of frames with their exposures, time stamps and images, and the text files that they are read from."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, nearest, read_only
from ospc.errors import ExposureError, MissingExtraError, RecordingError, counted, listed, quoted
from ospc.formats.files import by_name, read_bytes
from ospc.formats.scanning import NUMBER
from ospc.photometry.correction import EXPOSURE_RANGE_MS
from ospc.recording.exposure_units import in_seconds
from ospc.recording.image_source import is_image_name

MAX_LINES = 1_000_000
"""Maximum number of lines of a text file: nine hours at 30 frames per second."""

MAX_LINE_CHARACTERS = 4096
"""Maximum length of a line in a text file; a frame takes about fifty characters."""

_LINE_END = re.compile(r"\r\n|\n|\r")


def read_table_text(path: Path) -> str:
    """Read a text file; RecordingError if it cannot be read, is too large, or is not text."""
    data = read_bytes(path, error=RecordingError)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: not a text file in UTF-8; save it as plain text") from None
    if "\0" in text:
        raise RecordingError(f"{path}: not a text file; save it as plain text in UTF-8")
    return text


def lines_of(text: str, source: str) -> list[tuple[int, str]]:
    """Return the non-blank lines with their numbers, from 1; RecordingError if a limit is exceeded."""
    if text.count("\n") + text.count("\r") > 2 * MAX_LINES:
        raise RecordingError(f"{source}: has more than the {MAX_LINES} lines allowed; check the file")
    lines = [(number, line.strip()) for number, line in enumerate(_LINE_END.split(text), start=1) if line.strip()]
    for number, line in lines:
        if len(line) > MAX_LINE_CHARACTERS:
            raise RecordingError(
                f"{source}, line {number}: longer than {MAX_LINE_CHARACTERS} characters; check the file"
            )
    return lines


def is_number(text: str) -> bool:
    """Return whether a field is a number, including NaN and infinities."""
    return NUMBER.fullmatch(text) is not None


def parse_number(text: str, what: str, place: str) -> float:
    """Return the number in a field, which may be NaN or infinite.

    ``what`` and ``place`` name the field, and the file and line, in the message.

    Raises
    ------
    RecordingError
        If it is not a number.
    """
    if is_number(text):
        return float(text)
    if not text:
        unknown = ", or write nan if it is unknown" if what == "the exposure" else ""
        raise RecordingError(f"{place}: {what} is missing; add it{unknown}")
    remedy = "use a decimal point" if "," in text else "correct the line"
    remedy = "write fractions as decimal numbers, in a column exposure_s" if "/" in text else remedy
    raise RecordingError(f"{place}: {what} must be a number, not {quoted(text)}; {remedy}")


def exposures_in(path: str | Path) -> list[float]:
    """Return the last number of each line of a file, such as times.txt; lines that begin with ``#`` are comments.

    Errors are those of :func:`read_table_text` and :func:`parse_number`.
    """
    lines = [(n, line) for n, line in lines_of(read_table_text(Path(path)), str(path)) if not line.startswith("#")]
    return [
        parse_number(re.split(r"[\s,;]+", line.rstrip(",;"))[-1], "the exposure", f"{path}, line {n}")
        for n, line in lines
    ]


_LARGEST_STAMP = 1e20
"""Largest time stamp in any unit."""

_EARLIEST_S = 1e8
"""Earliest time since 1970, in 1973: smaller numbers are those of images, or of a clock that begins at 0."""

_SAME_TIME = 0.25
"""Largest difference of times that are the same but for rounding, relative to the time between frames."""

_INTEGER = re.compile(r"\d{1,30}", re.ASCII)
"""Image numbers; Python does not convert much longer ones."""

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

    ``lines`` are the line numbers of the frames, for messages; by default they count from 1.

    Raises
    ------
    ExposureError
        As for :func:`checked_exposures`.
    RecordingError
        If there are no frames, stamps do not increase, or an image is named twice.
    """
    numbers = lines or range(1, len(np.atleast_1d(exposures_ms)) + 1)
    if not numbers:
        raise RecordingError(f"{source}: has no frames; it needs one line per image")

    def where(frames: Sequence[int]) -> str:
        return at_lines(source, [numbers[i] for i in frames])

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
        raise ExposureError(
            f"{where(bad.tolist())}: the exposure must be a positive number of milliseconds, not "
            f"{exposures[bad[0]]:g}; {remedy}"
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


def table_or_unlisted(
    read: Callable[[], FrameTable], source: str, count: Callable[[], int], *, allowed: bool
) -> FrameTable:
    """Return the table from ``read``, or if ``allowed``, an :func:`unlisted` one if no exposures can be read."""
    try:
        return read()
    except (ExposureError, MissingExtraError):
        if not allowed or not (frames := count()):
            raise
    return unlisted(source, np.arange(frames, dtype=np.float64), stamped=False)


NO_EXPOSURES = "has no usable exposures"
NO_STAMPS = "has no time stamps; frames are numbered, one per second"
"""Endings of notes on unknown exposures or times."""


def unlisted(source: str, stamps_s: FloatArray, *, stamped: bool) -> FrameTable:
    """Return frames with unknown exposures, 1 ms each."""
    ones = read_only(np.ones(len(stamps_s)))
    return FrameTable(source, (), stamps_s, ones, (f"{source}: {NO_EXPOSURES}",), stamped)


def match_images(table: FrameTable, names: Sequence[str], place: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the image name of every row of a table, and notes.

    An image belongs to the row with its name, its name without suffix, or its number. Images that are named by their
    time may also belong to the row with this time in another unit. If rows and images are both numbered without gaps,
    but from different numbers, they are matched by order. ``names`` are the sorted file names in ``place``.

    Raises
    ------
    RecordingError
        If rows and images do not correspond.
    """
    as_many = len(table) == len(names)
    if not table.ids and as_many:
        return tuple(names), (f"{table.source}: has no image names; images are matched in the order of their names",)
    detail = ""
    if table.ids:
        by_key, stems = _by_key(names, place), [PurePosixPath(name).stem for name in names]
        found = [by_key.get(_composed(image)) or by_key.get(_number(image)) for image in table.ids]
        matching: tuple[str, ...] = ()
        if not any(found) and (by_time := _images_by_time(table, names, stems)):
            found, matching = by_time, (f"{table.source}: images are matched by the times in their names",)
        missing = [image for image, name in zip(table.ids, found, strict=True) if name is None]
        unused = sorted(set(names) - set(found), key=by_name)
        if as_many and not missing and not unused:
            return tuple(name for name in found if name is not None), matching
        none_match = len(missing) == len(table) and not any(is_image_name(image) for image in table.ids)
        if as_many and (none_match or all(_consecutive(texts) for texts in (table.ids, stems))):
            return tuple(names), (f"{table.source}: its ids are not image names; images are matched by order",)
        detail = f"; no image for {listed(missing)}" if missing else ""
        detail += f"; no line for {listed(unused)}" if unused else ""
    same = "other images than the" if as_many else f"{counted(len(table), 'frame')} but there are"
    raise RecordingError(
        f"{table.source}: lists {same} {counted(len(names), 'image')} in {place}{detail}; there must be one line "
        f"per image, with nan for an unknown exposure"
    )


def _images_by_time(table: FrameTable, names: Sequence[str], stems: Sequence[str]) -> list[str | None]:
    """Return the image named by each row's time, None if there is none; empty if no stems are times since 1970."""
    if not table.stamped or len(table) < 2 or not all(is_number(stem) for stem in stems):
        return []
    times_s, _ = in_seconds(np.array(stems, dtype=np.float64), table.source, stated=True)
    if min(times_s.min(), table.stamps_s[0]) < _EARLIEST_S:
        return []
    order = np.argsort(times_s)
    closest = order[nearest(times_s[order], table.stamps_s)]
    near = np.abs(times_s[closest] - table.stamps_s) < _SAME_TIME * float(np.median(np.diff(table.stamps_s)))
    return [names[i] if fits else None for i, fits in zip(closest.tolist(), near, strict=True)] if near.any() else []


def _number(text: str) -> str:
    """Return a key that is the same for 7, 07 and 00007 and differs from all file names."""
    return f"/{int(text)}" if _INTEGER.fullmatch(text) else ""


def _composed(text: str) -> str:
    """Return a text with composed characters: macOS writes ö as two characters."""
    return unicodedata.normalize("NFC", text)


def _by_key(names: Sequence[str], place: str) -> dict[str, str]:
    """Return the images by all keys that may name them; RecordingError if two images share a key."""
    keys: dict[str, str] = {}
    for name in names:
        path = PurePosixPath(name)
        for key in {_composed(name), _composed(path.name), _composed(path.stem), _number(path.stem)} - {""}:
            if keys.setdefault(key, name) != name:
                raise RecordingError(
                    f"{place}: {quoted(keys[key])} and {quoted(name)} cannot be distinguished by their names; "
                    f"rename one of them"
                )
    return keys


def _consecutive(texts: Sequence[str]) -> bool:
    """Return whether texts are consecutive numbers."""
    if not all(_INTEGER.fullmatch(text) for text in texts):
        return False
    numbers = [int(text) for text in texts]
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))
