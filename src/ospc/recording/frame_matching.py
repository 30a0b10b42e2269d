"""Which image belongs to which row of a list of exposures."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePosixPath

import numpy as np

from ospc.arrays import nearest, read_only
from ospc.errors import RecordingError, counted, listed, quoted
from ospc.formats.files import by_name
from ospc.recording.exposure_units import in_seconds
from ospc.recording.frame_table import FrameTable
from ospc.recording.image_source import is_image_name
from ospc.recording.list_columns import Columns
from ospc.recording.table_text import is_number

_EARLIEST_S = 1e8
"""Earliest time since 1970, in 1973: smaller numbers are those of images, or of a clock that begins at 0."""

_SAME_TIME = 0.25
"""Largest difference of times that are the same but for rounding, relative to the time between frames."""

_NAMING_SHARE = 0.5
"""Share of the rows from which on a column without a header for names counts as naming the images."""

_INTEGER = re.compile(r"\d{1,30}", re.ASCII)
"""Image numbers; Python does not convert much longer ones."""


def file_name(text: str) -> str:
    """Return the name of a file without its folders, which may be those of another system."""
    return PurePosixPath(text.replace("\\", "/")).name


def image_column(columns: Columns, texts: Sequence[Sequence[str]], images: Sequence[str]) -> int | None:
    """Return the column that names the images of a recording; None if only time stamps or the order may tell.

    A column with a header for names is used if its fields name images. Otherwise, another column is used whose fields
    are these names, whatever its header is. ``texts`` are the fields of each column, ``images`` the file names.
    """
    names = {key for image in images for key in _texts_of(image)}
    numbers = {_number(PurePosixPath(image).stem) for image in images} - {""}
    used = {columns.exposure, columns.stamp, *(column for column, _, _ in columns.gains)}
    fields = {i: [_composed(file_name(text)) for text in column] for i, column in enumerate(texts) if i not in used}

    def is_name(text: str) -> bool:
        # With another suffix, it names the image before it was converted, which is no reason to match by order.
        named = text in names or (is_image_name(text) and PurePosixPath(text).stem in names)
        return named and not _INTEGER.fullmatch(text)

    def as_named(column: int) -> int:
        return len({text for text in fields[column] if is_name(text)})

    def all_found(column: int) -> bool:
        found = {text if text in names else _number(text) for text in fields[column]}
        return found <= names | numbers and len(found) == len(fields[column])

    stated = columns.image
    if stated in fields and all_found(stated):
        return stated
    for column in (stated, max(fields, key=as_named, default=None)):
        if column is not None and as_named(column) >= _NAMING_SHARE * len(fields[column]):
            return column
    if stated is not None:
        return stated
    return next((column for column in fields if all_found(column) and len(fields[column]) == len(images)), None)


def match_images(table: FrameTable, names: Sequence[str], place: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the image name of every row of a table, and notes.

    An image belongs to the row with its name, its name without suffix, or its number, which may be the only part in
    which the names differ. Images that are named by their time may also belong to the row with this time in another
    unit. If rows and images are both numbered without gaps, but from different numbers, they are matched by order.
    ``names`` are the sorted file names in ``place``.

    Raises
    ------
    RecordingError
        If rows and images do not correspond.
    """
    stems = [PurePosixPath(name).stem for name in names]
    numbers = _numbers_in(stems)
    found, notes = _by_names(table, names, numbers, place), tuple[str, ...]()
    if not any(found) and (by_time := _by_times(table, names, stems)):
        found, notes = by_time, (f"{table.source}: images are matched by the times in their names",)
    as_many = len(table) == len(names)
    if as_many and set(found) == set(names):
        return tuple(name for name in found if name is not None), notes
    if as_many and (reason := _by_order(table, found, numbers)):
        return tuple(names), (f"{table.source}: {reason}",)
    missing = [image for image, name in zip(table.ids, found, strict=True) if name is None]
    unused = sorted(set(names) - set(found), key=by_name) if table.ids else []
    detail = f"; no image for {listed(missing)}" if missing else ""
    detail += f"; no line for {listed(unused)}" if unused else ""
    same = "other images than the" if as_many else f"{counted(len(table), 'frame')} but there are"
    raise RecordingError(
        f"{table.source}: lists {same} {counted(len(names), 'image')} in {place}{detail}; there must be one line "
        f"per image, with nan for an unknown exposure"
    )


def _by_names(table: FrameTable, names: Sequence[str], numbers: Sequence[str], place: str) -> list[str | None]:
    """Return the image named by each row or its number, None if there is none."""
    by_key = _by_key(names, place) if table.ids else {}
    by_number = {key: name for number, name in zip(numbers, names, strict=True) if (key := _number(number))}
    return [
        by_key.get(_composed(image)) or by_key.get(_number(image)) or by_number.get(_number(image))
        for image in table.ids
    ]


def _by_order(table: FrameTable, found: Sequence[str | None], numbers: Sequence[str]) -> str:
    """Return why images belong to the rows in their order, although names and times do not tell; empty if not."""
    if not table.ids:
        return "has no image names; images are matched in the order of their names"
    none_match = not any(found) and not any(is_image_name(image) for image in table.ids)
    in_order = none_match or (_consecutive(table.ids) and _consecutive(numbers))
    return "its ids are not image names; images are matched by order" if in_order else ""


def in_order_of_numbers(
    table: FrameTable, names: tuple[str, ...]
) -> tuple[FrameTable, tuple[str, ...], tuple[str, ...]]:
    """Return rows and their images in the order of the images' numbers, and notes.

    The order of the rows is kept if they have time stamps, or if names differ in more than their numbers.
    """
    if table.stamped or not _alike_but_for_numbers(names):
        return table, names, ()
    order = sorted(range(len(names)), key=lambda i: by_name(names[i]))
    if order == list(range(len(names))):
        return table, names, ()
    note = f"{table.source}: is in another order than the images' numbers; frames are in the order of the numbers"
    ids = tuple(table.ids[i] for i in order) if table.ids else ()
    ordered = replace(table, ids=ids, exposures_ms=read_only(table.exposures_ms[order]))
    return ordered, tuple(names[i] for i in order), (note,)


def frame_numbers(texts: Sequence[str]) -> list[int]:
    """Return the numbers of frames; empty if some texts are not numbers of frames."""
    return [int(text) for text in texts] if all(_INTEGER.fullmatch(text) for text in texts) else []


def match_frames(table: FrameTable, frames: int, place: str) -> tuple[str, ...]:
    """Check that a table has one row for each frame of a video, and return notes.

    Rows belong to the frames with their numbers, which count from 0 or 1, and are sorted by them. Other ids, such as
    the numbers of a camera that counts on, do not tell which frame is meant; then rows are matched by order.

    Raises
    ------
    RecordingError
        If rows and frames do not correspond.
    """
    numbers, as_many, detail = frame_numbers(table.ids), len(table) == frames, ""
    # Most ids of another meaning, such as times, are larger than the number of frames.
    in_range = bool(numbers) and numbers[len(numbers) // 2] <= frames
    if in_range and (numbers[0] <= 1 or numbers[-1] <= frames):
        first = 1 if numbers[0] == 1 or (numbers[0] > 1 and numbers[-1] == frames) else 0
        expected = range(first, first + frames)
        missing = sorted(set(expected) - set(numbers))
        unused = [number for number in numbers if number not in expected]
        if as_many and not missing:
            return ()
        detail = f"; no line for frame {listed(missing)}, counted from {first}" if missing else ""
        detail += f"; no frame {listed(unused)}" if unused else ""
    elif as_many:
        by_order = f"{table.source}: its ids do not count frames from 0 or 1; frames are matched by order"
        return (by_order,) if table.ids else ()
    has = f"other frames than {place} has" if as_many else f"{counted(len(table), 'frame')} but {place} has {frames}"
    raise RecordingError(
        f"{table.source}: lists {has}{detail}; there must be one line per frame, with nan for an unknown exposure"
        f"{', or remove the ids if they do not count these frames' if as_many else ''}"
    )


def _by_times(table: FrameTable, names: Sequence[str], stems: Sequence[str]) -> list[str | None]:
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


def _alike_but_for_numbers(names: Sequence[str]) -> bool:
    return len({re.sub(r"\d+", "0", name) for name in names}) == 1


def _numbers_in(stems: Sequence[str]) -> list[str]:
    """Return the number by which names differ, of each name; the names themselves if they differ in more."""
    if not _alike_but_for_numbers(stems):
        return list(stems)
    differing = [
        texts for texts in zip(*(re.findall(r"\d+", stem) for stem in stems), strict=True) if len({*texts}) > 1
    ]
    return list(differing[0]) if len(differing) == 1 else list(stems)


def _composed(text: str) -> str:
    """Return a text with composed characters: macOS writes ö as two characters."""
    return unicodedata.normalize("NFC", text)


def _texts_of(name: str) -> set[str]:
    """Return the texts that may name an image in a list."""
    path = PurePosixPath(name)
    return {_composed(name), _composed(path.name), _composed(path.stem)}


def _by_key(names: Sequence[str], place: str) -> dict[str, str]:
    """Return the images by all keys that may name them; RecordingError if two images share a key."""
    keys: dict[str, str] = {}
    for name in names:
        for key in {*_texts_of(name), _number(PurePosixPath(name).stem)} - {""}:
            if keys.setdefault(key, name) != name:
                raise RecordingError(
                    f"{place}: {quoted(keys[key])} and {quoted(name)} cannot be distinguished by their names; "
                    f"rename one of them"
                )
    return keys


def _consecutive(texts: Sequence[str]) -> bool:
    """Return whether texts are consecutive numbers."""
    numbers = frame_numbers(texts)
    return bool(numbers) and numbers == list(range(numbers[0], numbers[0] + len(numbers)))
