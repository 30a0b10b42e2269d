"""The rules for times.txt: time stamps and exposures of all images."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.errors import FormatError, counted, listed
from ospc.formats.dso import LARGEST_ID, write_times
from ospc.formats.files import BYTE_ORDER_MARK, by_name, read_text
from ospc.formats.rules import MOST_INTERPOLATED, Broken, Context, Format, mark_before
from ospc.formats.scanning import NUMBER, scanned, words_of

_LONGEST_LINE = 999
"""Largest line length, in characters, for the line buffers of the programs."""

_WORD = re.compile(r"\S+", re.ASCII)
_WHOLE_NUMBER = re.compile(r"[+-]?\d+", re.ASCII)

_PLAUSIBLE_MS = (0.05, 2000.0)
"""Range of plausible median exposures; others are probably in seconds or microseconds."""

_LONGEST_INTERVAL_S = 60.0
"""Longest plausible median interval between images; longer ones are probably in milliseconds or nanoseconds."""

_LOST = {
    "dso": "silently drops all time stamps and all exposures and runs with exposure 1",
    "mono": "sets all time stamps and exposures to zero",
}
_SKIPPED = f"silently skips these lines; then the counts differ and it {_LOST['dso']}"
_LAYOUT = "every line is 'id stamp[s] exposure[ms]'"
_IS, _HAS = ("is", "are"), ("has", "have")
_WRITE_AGAIN = "write times.txt again from the source of the recording"


class _Row(NamedTuple):
    """The number of a line, from 1, and its words."""

    number: int
    words: list[str]


@dataclass(frozen=True)
class TimesText:
    """The text of a times.txt, as the programs read it."""

    text: str

    @cached_property
    def lines(self) -> list[str]:
        """All lines, without a byte order mark."""
        return self.text.removeprefix(BYTE_ORDER_MARK).split("\n")

    @cached_property
    def rows(self) -> tuple[_Row, ...]:
        """The lines that are not comments and not blank."""
        split = (_Row(number, _WORD.findall(line)) for number, line in enumerate(self.lines, start=1))
        return tuple(row for row in split if row.words and not row.words[0].startswith("#"))

    @cached_property
    def scanned(self) -> FloatArray:
        """Ids, stamps in s and exposures in ms as read by DSO, shape (lines, 3); missing exposures are 0."""
        values: list[list[float]] = []
        for line in self.lines:
            if len(line) > _LONGEST_LINE:
                break
            row = scanned(line, "dff")
            if len(row) >= 2:
                values.append([*row, 0.0][:3])
        return np.array(values, dtype=np.float64).reshape(-1, 3)

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposures as stored by DSO, in 32 bits, shape (lines,)."""
        with np.errstate(over="ignore", under="ignore"):
            return self.scanned[:, 2].astype(np.float32).astype(np.float64)

    @property
    def without_exposures(self) -> bool:
        """Whether the lines only have ids and time stamps, as if no exposures are known."""
        return all(len(row.words) == 2 and _WHOLE_NUMBER.fullmatch(row.words[0]) for row in self.rows)

    def with_rows(self, rows: list[list[str]]) -> TimesText:
        """Return a text with other lines."""
        return TimesText("".join(" ".join(words) + "\n" for words in rows))


def _neighbour_filled(exposures_ms: FloatArray) -> FloatArray:
    """Return exposures in which each zero is replaced in order by the mean of its positive neighbours, as in DSO."""
    filled = exposures_ms.copy()
    for i in np.flatnonzero(filled == 0):
        neighbours = [filled[j] for j in (i - 1, i + 1) if 0 <= j < filled.size and filled[j] > 0]
        if neighbours:
            filled[i] = float(np.mean(neighbours))
    return filled


def _about_the_mark(times: TimesText, context: Context) -> Iterator[Broken]:
    effect = f"silently skips the first line; then the counts differ and it {_LOST[context.program]}"
    return mark_before(times.text, effect, TimesText)


def _about_the_lines(times: TimesText, _context: Context) -> Iterator[Broken]:
    number = next((i for i, line in enumerate(times.lines, 1) if len(line) > _LONGEST_LINE), None)
    if number is not None:
        rule = f"lines of up to {_LONGEST_LINE} characters; line {number} is longer"
        yield Broken("error", rule, "stops reading there", "shorten the line")
    if bad := [row for row in times.rows if _has_commas(row)]:
        rule = f"values are separated by spaces; {_first_of(bad)}"
        effect = "stops at the first other character, so it drops the line or reads only part of a number"
        yield Broken("error", rule, effect, "write decimal points, and spaces between values", _separate_by_spaces)
    if bad := [row for row in times.rows if not _has_stamp(row) and not _has_commas(row)]:
        yield Broken("error", f"{_LAYOUT}; {_first_of(bad)}", _SKIPPED, _WRITE_AGAIN, _drop_lines_without_stamp)


def _about_the_count(times: TimesText, context: Context) -> Iterator[Broken]:
    if not times.rows:
        yield Broken("error", "one line per image; there is none", _LOST[context.program], _WRITE_AGAIN)
    elif context.images is not None and len(times.rows) != len(context.images):
        found = f"{counted(len(times.rows), 'line')} for {counted(len(context.images), 'file')} in images"
        lines = {_image_key(row.words[0]): row.words[0] for row in times.rows}
        images = {_image_key(name): name for name in context.images}
        missing = [images[key] for key in images if key not in lines]
        extra = [lines[key] for key in lines if key not in images]
        rule, remedy = f"one line per image; {found}", "add or remove lines until they agree"
        if len(missing) < len(images):  # ids are names or numbers of images
            rule += f"; no line for {listed(missing)}" if missing else ""
            rule += f"; no image for {listed(extra)}" if extra else ""
            remedy = "add the missing lines, or remove their images" if missing else "remove the extra lines"
        yield Broken("error", rule, _LOST[context.program], remedy, _drop_lines_without_image)


def _about_the_image_order(_times: TimesText, context: Context) -> Iterator[Broken]:
    """Check that programs, which sort names as text, do not read image 10 before image 2."""
    images = context.images or ()
    pairs = zip(images, sorted(images, key=by_name), strict=True)
    early, due = next(((found, due) for found, due in pairs if found != due), ("", ""))
    if early:
        rule = f"image names, sorted as text, are in the order of their numbers; {early!r} comes before {due!r}"
        effect = "reads the images in another order and pairs them with the wrong lines"
        yield Broken("error", rule, effect, "number the images with leading zeros, as 'ospc convert' does")


def _about_the_ids_and_images(times: TimesText, context: Context) -> Iterator[Broken]:
    if bad := [
        r for r in times.rows if _has_stamp(r) and not _has_commas(r) and not _WHOLE_NUMBER.fullmatch(r.words[0])
    ]:
        is_split = len(scanned(" ".join(bad[0].words), "dff")) > 1
        effect = "reads the digits before the point as id, those after it as time stamp, and the stamp as exposure"
        rule = f"{_LAYOUT} with an integer id; {_first_of(bad)}"
        yield Broken("error", rule, effect if is_split else _SKIPPED, "number the images", _number_lines)
    ids = times.scanned[:, 0]
    if np.any((ids < 0) | (ids > LARGEST_ID)):
        rule = "ids are non-negative 32-bit integers; some are not, and may be time stamps in nanoseconds"
        effect = "reads wrong ids, which it does not use; other C libraries may drop the lines"
        yield Broken("warning", rule, effect, "number the images from 0", _number_lines)
    if context.images is None and times.rows:
        rule = f"one line per image; the file has {counted(len(times.rows), 'line')}"
        effect = f"was not compared, because the images were not found; if they differ, it {_LOST[context.program]}"
        yield Broken("note", rule, effect, "check it in a folder that also contains images/ or images.zip")


def _about_the_exposures(times: TimesText, context: Context) -> Iterator[Broken]:
    if context.program == "dso" and times.rows and times.without_exposures:
        yield Broken("note", "the third column has the exposures; there is none", "runs without exposures")
        return
    exposures_ms = times.exposures_ms
    zero, valid = exposures_ms == 0, np.isfinite(exposures_ms) & (exposures_ms > 0)
    invalid = ~zero & ~valid
    if invalid.any():
        rule = f"exposures are positive; {_count_of(invalid, _IS, 'negative or not a number')}"
        effect = "does not correct these images, or its brightness transfer becomes NaN"
        yield Broken("error", rule, effect, "correct them", _fill_exposures)
    left = _neighbour_filled(exposures_ms) == 0
    if context.program == "dso" and left.any():
        rule = f"every zero exposure has a positive neighbour; {_count_of(left, _HAS, 'none')}"
        remedy = "record exposures, or leave out the third column of all lines"
        yield Broken("error", rule, "drops the exposures of all images", remedy, _fill_exposures)
    if zero.any() and not (context.program == "dso" and zero.all()):
        rule = f"exposures are positive; {_count_of(zero, _IS, 'zero or missing')}"
        mono = context.program == "mono"
        effect = "passes the zeros on" if mono else "replaces them by the mean of their neighbours"
        remedy = "record the missing exposures"
        yield Broken("error" if mono else "warning", rule, effect, remedy, _fill_exposures)
    known = exposures_ms[valid]
    if known.size and not _PLAUSIBLE_MS[0] <= (median := float(np.median(known))) <= _PLAUSIBLE_MS[1]:
        unit = "seconds" if median < _PLAUSIBLE_MS[0] else "microseconds"
        rule = f"exposures are in milliseconds; their median is {median:g}, as if they were in {unit}"
        yield Broken("warning", rule, "only uses their ratios and does not notice", "convert them")
    if known.size > 2 and known.min() == known.max():
        effect = "does not benefit from them, and no response can be calibrated"
        yield Broken("note", f"exposures vary; all are {known[0]:g} ms", effect)


def _about_the_stamps(times: TimesText, _context: Context) -> Iterator[Broken]:
    with np.errstate(invalid="ignore"):  # infinite stamps do not increase either
        steps = np.diff(times.scanned[:, 1])
    if not np.all(steps > 0):
        rule = f"time stamps increase; after line {int(np.argmin(steps > 0)) + 1} they do not"
        yield Broken("warning", rule, "plays the images in order and writes stamps that do not increase")
    elif steps.size and (median := float(np.median(steps))) > _LONGEST_INTERVAL_S:
        rule = f"time stamps are in seconds; they advance by {median:g}, as if they were in milli- or nanoseconds"
        effect = "cannot play images in real time, and its trajectory cannot be matched with a ground truth"
        yield Broken("warning", rule, effect, "convert them")


def _separate_by_spaces(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    rows = [words_of(" ".join(row.words)) for row in times.rows]
    if any(len(found) > 3 and _has_commas(row) for found, row in zip(rows, times.rows, strict=True)):
        raise FormatError("some commas look like decimal points; write decimal points, and spaces between values")
    return times.with_rows(rows), "replaced commas or semicolons by spaces"


def _drop_lines_without_stamp(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    kept = [row.words for row in times.rows if _has_stamp(row)]
    return times.with_rows(kept), f"dropped {counted(len(times.rows) - len(kept), 'line')} without stamp"


def _drop_lines_without_image(times: TimesText, context: Context) -> tuple[TimesText, str]:
    """Keep the lines whose ids are the names of the images, in the order of the images."""
    images = context.images or ()
    line_of = {_image_key(row.words[0]): row.words for row in times.rows}
    missing = next((image for image in images if _image_key(image) not in line_of), None)
    if missing is not None or not images:
        raise FormatError(
            f"{counted(len(times.rows), 'line')} for {counted(len(images), 'image')}, and no line has the name of "
            f"the image {missing or '(there is none)'}, so lines cannot be matched with images; {_WRITE_AGAIN}"
        )
    kept = [line_of[_image_key(image)] for image in images]
    return times.with_rows(kept), f"dropped {counted(len(times.rows) - len(kept), 'line')} without an image"


def _number_lines(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    if any(len(row.words) == 2 and "." in row.words[0] and NUMBER.fullmatch(row.words[0]) for row in times.rows):
        raise FormatError(f"it is unclear whether the two columns are time stamps and exposures; {_WRITE_AGAIN}")
    rows = [[str(i), *row.words[1:]] for i, row in enumerate(times.rows)]
    return times.with_rows(rows), "replaced ids that are not 32-bit integers by the numbers 0, 1, 2, …"


def _fill_exposures(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    """Interpolate the logarithms of missing exposures between their neighbours."""
    exposures = times.exposures_ms
    known: BoolArray = np.isfinite(exposures) & (exposures > 0)
    missing = int(np.count_nonzero(~known))
    if missing > MOST_INTERPOLATED * exposures.size:
        raise FormatError(
            f"{missing} of {exposures.size} exposures are missing, too many to interpolate; record them, or leave "
            f"out the third column"
        )
    places = np.arange(exposures.size)
    exposures[~known] = np.exp(np.interp(places[~known], places[known], np.log(exposures[known])))
    # The stamps as they are read: words after the number would hide the new exposure.
    read = zip(times.rows, times.scanned[:, 1], exposures, strict=True)
    rows = [[row.words[0], f"{stamp:.9f}", f"{exposure:.9g}"] for row, stamp, exposure in read]
    change = f"interpolated {counted(missing, 'missing or invalid exposure')} between neighbours"
    return times.with_rows(rows), change


def _image_key(name: str) -> str:
    """Return a key that is the same for 7, 00007 and 00007.png."""
    stem = Path(name).stem
    return stem.lstrip("0") or "0" if stem.isdecimal() else stem


def _has_commas(row: _Row) -> bool:
    return any("," in word or ";" in word for word in row.words)


def _has_stamp(row: _Row) -> bool:
    stamp = scanned(row.words[1], "f") if len(row.words) >= 2 else []
    return bool(stamp) and math.isfinite(stamp[0])


def _first_of(rows: list[_Row]) -> str:
    differ = "line differs" if len(rows) == 1 else "lines differ"
    return f"{len(rows)} {differ}, first line {rows[0].number}: {' '.join(rows[0].words)[:40]!r}"


def _count_of(where: BoolArray, verbs: tuple[str, str], what: str) -> str:
    """Return a phrase with the number of rows that are true, a singular or plural verb, and the first of them."""
    count = int(np.count_nonzero(where))
    return f"{count} of {where.size} {verbs[count > 1]} {what}, first in row {int(np.argmax(where)) + 1}"


def _write(times: TimesText, path: Path) -> Path:
    ids, stamps_s, exposures_ms = times.scanned.T
    return write_times(path, [int(i) for i in ids], stamps_s, None if times.without_exposures else exposures_ms)


TIMES: Format[TimesText] = Format(
    lambda path: TimesText(read_text(path, keep_mark=True)),
    _write,
    (
        _about_the_mark,
        _about_the_lines,
        _about_the_count,
        _about_the_image_order,
        _about_the_ids_and_images,
        _about_the_exposures,
        _about_the_stamps,
    ),
)
