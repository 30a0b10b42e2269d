"""The rules for times.txt: time stamp and exposure of every image."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.errors import FormatError
from ospc.formats.dso import LARGEST_ID, write_times
from ospc.formats.files import read_text
from ospc.formats.rules import Context, Finding, Format, Rule
from ospc.formats.scanning import scanned
from ospc.formats.times_lines import LONGEST_LINE, Row, TimesText, neighbour_filled

_WHOLE_NUMBER = re.compile(r"[+-]?\d+", re.ASCII)

_PLAUSIBLE_MS = (0.05, 2000.0)
"""Median exposures outside this range are probably in seconds or microseconds."""

_LONGEST_INTERVAL_S = 60.0
"""Median intervals between images above this are probably in milliseconds or nanoseconds."""

_MOST_INTERPOLATED = 0.1
"""Largest share of the exposures that a repair interpolates."""

_EVERYTHING_LOST = {
    "dso": "drops all time stamps and all exposures without a word and runs with exposure 1",
    "mono": "sets all time stamps and exposures to zero",
}
_LAYOUT = "every line is 'id stamp[s] exposure[ms]'"
_WRITE_ANEW = "write times.txt again from the recording's source"


def _lines_fit(times: TimesText, _context: Context) -> Finding | None:
    number = next((i for i, line in enumerate(times.text.split("\n"), 1) if len(line) > LONGEST_LINE), None)
    if number is None:
        return None
    rule = f"lines of up to {LONGEST_LINE} characters; line {number} is longer"
    return Finding("error", rule, "stops reading there", "shorten the line")


def _separated_by_spaces(times: TimesText, _context: Context) -> Finding | None:
    bad = [row for row in times.rows if _has_commas(row)]
    if not bad:
        return None
    effect = "stops at the first of them, and so drops the line or takes part of a number for the whole"
    rule = f"values are separated by spaces; {_first_of(bad)}"
    return Finding("error", rule, effect, "separate the values by spaces")


def _separate_by_spaces(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    rows = [[word for word in re.split(r"[\s,;]+", " ".join(row.words)) if word] for row in times.rows]
    if any(len(words) > 3 and _has_commas(row) for words, row in zip(rows, times.rows, strict=True)):
        raise FormatError("some commas look like decimal points; write decimal points, and spaces between values")
    return times.with_rows(rows), "commas or semicolons replaced by spaces"


def _lines_have_stamps(times: TimesText, _context: Context) -> Finding | None:
    bad = [row for row in times.rows if not _has_stamp(row) and not _has_commas(row)]
    if not bad:
        return None
    effect = f"passes over these lines without a word; then the counts differ and it {_EVERYTHING_LOST['dso']}"
    return Finding("error", f"{_LAYOUT}; {_first_of(bad)}", effect, _WRITE_ANEW)


def _drop_lines_without_stamp(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    kept = [row.words for row in times.rows if _has_stamp(row)]
    return times.with_rows(kept), f"{len(times.rows) - len(kept)} lines without stamp dropped"


def _has_lines(times: TimesText, context: Context) -> Finding | None:
    if times.rows:
        return None
    return Finding("error", "one line per image; there is none", _EVERYTHING_LOST[context.program], _WRITE_ANEW)


def _images_are_known(times: TimesText, context: Context) -> Finding | None:
    if context.images is not None or not times.rows:
        return None
    lost = _EVERYTHING_LOST[context.program]
    effect = f"was not compared, because the images were not found; if they differ, it {lost}"
    return Finding("note", f"one line per image; there are {len(times.rows)} lines", effect, "check the whole folder")


def _one_line_per_image(times: TimesText, context: Context) -> Finding | None:
    if context.images is None or not times.rows or len(times.rows) == len(context.images):
        return None
    rule = f"one line per image; {len(times.rows)} lines for {len(context.images)} files in images"
    return Finding("error", rule, _EVERYTHING_LOST[context.program], "remove the surplus")


def _drop_lines_without_image(times: TimesText, context: Context) -> tuple[TimesText, str]:
    """Keep the lines whose ids are the names of the images, in the order of the images."""
    images = context.images or ()
    line_of = {Path(row.words[0]).stem: row.words for row in times.rows}
    missing = next((image for image in images if Path(image).stem not in line_of), None)
    if missing is not None or not images:
        raise FormatError(
            f"{len(times.rows)} lines for {len(images)} images, and no line is called like the image "
            f"{missing or '(there is none)'}, so nothing says which line belongs to which image; {_WRITE_ANEW}"
        )
    kept = [line_of[Path(image).stem] for image in images]
    return times.with_rows(kept), f"{len(times.rows) - len(kept)} lines without an image dropped"


def _ids_are_integers(times: TimesText, _context: Context) -> Finding | None:
    bad = [row for row in times.rows if _has_stamp(row) and not _has_commas(row) and not _is_whole(row.words[0])]
    if not bad:
        return None
    torn = scanned(" ".join(bad[0].words), "dff")
    effect = (
        "takes the digits before the point as id, those after it as time stamp and the stamp as exposure"
        if len(torn) > 1
        else f"passes over these lines without a word; then the counts differ and it {_EVERYTHING_LOST['dso']}"
    )
    return Finding("error", f"{_LAYOUT} with an integer id; {_first_of(bad)}", effect, "number the images")


def _ids_fit_32_bits(times: TimesText, _context: Context) -> Finding | None:
    ids = times.scanned[:, 0]
    if not np.any((ids < 0) | (ids > LARGEST_ID)):
        return None
    return Finding(
        "warning",
        "ids fit 32 bits and are not negative; these are not such numbers, and may be time stamps in nanoseconds",
        "reads garbage ids, which it does not use; other C libraries may drop the lines",
        "number the images from 0",
    )


def _number_lines(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    rows = [[str(i), *row.words[1:]] for i, row in enumerate(times.rows)]
    return times.with_rows(rows), "ids that are no 32-bit integers replaced by the numbers 0, 1, 2, …"


def _exposures_are_valid(times: TimesText, _context: Context) -> Finding | None:
    bad = ~np.isfinite(times.exposures_ms) | (times.exposures_ms < 0)
    if not bad.any():
        return None
    effect = "leaves those images uncorrected, or carries NaN into its brightness transfer"
    return Finding(
        "error", f"exposures are positive; {_places(bad)} negative or not a number", effect, "correct them"
    )


def _zeros_have_neighbours(times: TimesText, context: Context) -> Finding | None:
    left = neighbour_filled(times.exposures_ms) == 0
    if context.program != "dso" or not left.any():
        return None
    remedy = "record exposures; if there are none, leave the third column out of all lines"
    rule = f"a zero exposure has a positive neighbour; {_places(left)} without"
    return Finding("error", rule, "drops the exposures of all images", remedy)


def _no_exposure_is_zero(times: TimesText, context: Context) -> Finding | None:
    zero = times.exposures_ms == 0
    if not zero.any() or (context.program == "dso" and zero.all()):
        return None
    rule, remedy = f"exposures are positive; {_places(zero)} zero or missing", "record the missing exposures"
    if context.program == "mono":
        return Finding("error", rule, "passes the zeros on", remedy)
    return Finding("warning", rule, "replaces them by the mean of their neighbours", remedy)


def _fill_exposures(times: TimesText, _context: Context) -> tuple[TimesText, str]:
    """Interpolate the logarithms of missing exposures between their neighbours."""
    exposures = times.exposures_ms.copy()
    known: BoolArray = np.isfinite(exposures) & (exposures > 0)
    missing = int(np.count_nonzero(~known))
    if missing > _MOST_INTERPOLATED * exposures.size:
        raise FormatError(
            f"{missing} of {exposures.size} exposures are missing, too many to interpolate; record them, or leave "
            f"the third column out"
        )
    places = np.arange(exposures.size)
    exposures[~known] = np.exp(np.interp(places[~known], places[known], np.log(exposures[known])))
    rows = [[*row.words[:2], f"{exposure:.9g}"] for row, exposure in zip(times.rows, exposures, strict=True)]
    return times.with_rows(rows), f"{missing} missing or invalid exposures interpolated between their neighbours"


def _exposures_are_in_ms(times: TimesText, _context: Context) -> Finding | None:
    valid = _valid(times.exposures_ms)
    if not valid.size or _PLAUSIBLE_MS[0] <= (median := float(np.median(valid))) <= _PLAUSIBLE_MS[1]:
        return None
    unit = "seconds" if median < _PLAUSIBLE_MS[0] else "microseconds"
    rule = f"exposures are in milliseconds; their median is {median:g}, as if they were in {unit}"
    return Finding("warning", rule, "uses only their ratios and does not notice", "convert them")


def _exposures_vary(times: TimesText, _context: Context) -> Finding | None:
    valid = _valid(times.exposures_ms)
    if valid.size <= 2 or valid.min() < valid.max():
        return None
    effect = "gains nothing from them, and no response can be calibrated"
    return Finding("note", f"exposures vary; all are {valid[0]:g} ms", effect)


def _stamps_increase(times: TimesText, _context: Context) -> Finding | None:
    steps = np.diff(times.scanned[:, 1])
    if np.all(steps > 0):
        return None
    rule = f"time stamps increase; after line {int(np.argmin(steps > 0)) + 1} they do not"
    return Finding("warning", rule, "plays the images in order and writes stamps that do not increase")


def _stamps_are_in_seconds(times: TimesText, _context: Context) -> Finding | None:
    steps = np.diff(times.scanned[:, 1])
    if not steps.size or not np.all(steps > 0) or (median := float(np.median(steps))) <= _LONGEST_INTERVAL_S:
        return None
    rule = f"time stamps are in seconds; they advance by {median:g}, as if in milli- or nanoseconds"
    effect = "cannot play them in real time, nor can they be matched with a ground truth"
    return Finding("warning", rule, effect, "convert them")


def _has_commas(row: Row) -> bool:
    return any("," in word or ";" in word for word in row.words)


def _has_stamp(row: Row) -> bool:
    stamp = scanned(row.words[1], "f") if len(row.words) >= 2 else []
    return bool(stamp) and math.isfinite(stamp[0])


def _is_whole(word: str) -> bool:
    return _WHOLE_NUMBER.fullmatch(word) is not None


def _first_of(rows: list[Row]) -> str:
    return f"{len(rows)} are not, first line {rows[0].number}: {' '.join(rows[0].words)[:40]!r}"


def _valid(exposures_ms: FloatArray) -> FloatArray:
    return np.asarray(exposures_ms[np.isfinite(exposures_ms) & (exposures_ms > 0)])


def _places(where: BoolArray) -> str:
    count = int(np.count_nonzero(where))
    return f"{count} of {where.size} are, first in row {int(np.argmax(where)) + 1},"


def _write(times: TimesText, path: Path) -> Path:
    ids, stamps_s, exposures_ms = times.scanned.T
    return write_times(path, [int(i) for i in ids], stamps_s, exposures_ms)


TIMES: Format[TimesText] = Format(
    read=lambda path: TimesText(read_text(path)),
    write=_write,
    rules=(
        Rule(_lines_fit),
        Rule(_separated_by_spaces, _separate_by_spaces),
        Rule(_lines_have_stamps, _drop_lines_without_stamp),
        Rule(_has_lines),
        Rule(_one_line_per_image, _drop_lines_without_image),
        Rule(_ids_are_integers, _number_lines),
        Rule(_ids_fit_32_bits, _number_lines),
        Rule(_images_are_known),
        Rule(_exposures_are_valid, _fill_exposures),
        Rule(_zeros_have_neighbours, _fill_exposures),
        Rule(_no_exposure_is_zero, _fill_exposures),
        Rule(_exposures_are_in_ms),
        Rule(_exposures_vary),
        Rule(_stamps_increase),
        Rule(_stamps_are_in_seconds),
    ),
)
