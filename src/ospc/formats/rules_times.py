"""The rules for times.txt, time stamp and exposure of every image."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.formats.dso import LARGEST_ID
from ospc.formats.files import read_text
from ospc.formats.findings import Context, Finding
from ospc.formats.scanning import scanned

_REPAIR = "run with --repair for a mended copy"
_LONGEST_LINE = 999
_WHOLE_NUMBER = re.compile(r"\s*[+-]?\d+(\s|$)", re.ASCII)
_IN_MS = (0.05, 2000.0)
_LONGEST_PAUSE_S = 60.0


@dataclass(frozen=True)
class TimesLines:
    """What DSO takes from a times.txt.

    Attributes
    ----------
    ids
        As read, shape (lines,).
    stamps_s, exposures_ms
        As read, shape (lines,); an exposure that is not given is 0.
    dropped
        Number and text of the lines it passes over, blank ones and comments aside.
    torn
        Numbers of the lines whose id is no integer, so that its end was read as the stamp.
    cut_at
        Number of the line that ends the reading because it is too long; None if the file is read to its end.
    """

    ids: FloatArray
    stamps_s: FloatArray
    exposures_ms: FloatArray
    dropped: tuple[tuple[int, str], ...]
    torn: tuple[int, ...]
    cut_at: int | None


def scan_times(text: str) -> TimesLines:
    """Read a times.txt as DSO does: ``sscanf`` with ``"%d %lf %f"`` line by line."""
    rows: list[list[float]] = []
    dropped: list[tuple[int, str]] = []
    torn: list[int] = []
    cut_at = None
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > _LONGEST_LINE:
            cut_at = number
            break
        row = scanned(line, "dff")
        if len(row) >= 2:
            rows.append(row if len(row) == 3 else [*row, 0.0])
            if not _WHOLE_NUMBER.match(line):
                torn.append(number)
        elif line.strip() and not line.lstrip().startswith("#"):
            dropped.append((number, line.strip()))
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return TimesLines(table[:, 0], table[:, 1], table[:, 2], tuple(dropped), tuple(torn), cut_at)


def neighbour_filled(exposures_ms: FloatArray) -> FloatArray:
    """Return the exposures after DSO has replaced each zero by the mean of its positive neighbours, in order."""
    filled = exposures_ms.copy()
    for i in np.flatnonzero(filled == 0):
        neighbours = [filled[j] for j in (i - 1, i + 1) if 0 <= j < filled.size and filled[j] > 0]
        if neighbours:
            filled[i] = float(np.mean(neighbours))
    return filled


def check_times(path: Path, context: Context) -> Iterator[Finding]:
    """Give what is to be said about a times.txt.

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    name = str(path)
    lines = scan_times(read_text(path))
    yield from _about_lines(name, lines)
    yield from _about_count(name, lines, context)
    if lines.ids.size:
        yield from _about_exposures(name, lines.exposures_ms, context)
        yield from _about_units(name, lines)


def _about_lines(name: str, lines: TimesLines) -> Iterator[Finding]:
    if lines.torn:
        yield Finding(
            "error",
            name,
            f"ids are integers; in {len(lines.torn)} lines, first in line {lines.torn[0]}, they are not",
            "takes the digits before the point as id, those after it as time stamp and the stamp as exposure",
            f"write 'id stamp[s] exposure[ms]', or {_REPAIR}",
        )
    if lines.dropped:
        number, text = lines.dropped[0]
        yield Finding(
            "error",
            name,
            f"every line is 'id stamp[s] exposure[ms]' with an integer id; {len(lines.dropped)} are not, "
            f"first line {number}: {text[:40]!r}",
            "passes over these lines without a word; then the counts differ and it drops all stamps and exposures",
            _REPAIR,
        )
    if lines.cut_at is not None:
        rule = f"lines of up to {_LONGEST_LINE} characters; line {lines.cut_at} is longer"
        yield Finding("error", name, rule, "stops reading there", "shorten the line")
    if np.any(np.abs(lines.ids) > LARGEST_ID):
        yield Finding(
            "warning",
            name,
            "ids fit 32 bits; these do not, they look like time stamps in nanoseconds",
            "reads garbage ids, which it does not use; other C libraries may drop the lines",
            f"number the images from 0, or {_REPAIR}",
        )


def _about_count(name: str, lines: TimesLines, context: Context) -> Iterator[Finding]:
    count = lines.ids.size
    everything = {
        "dso": "drops all time stamps and all exposures without a word and runs with exposure 1",
        "mono": "sets all time stamps and exposures to zero",
    }[context.program]
    if count == 0:
        yield Finding("error", name, "one line per image; there is none", everything, "write times.txt anew")
    elif context.images is None:
        rule = f"one line per image; there are {count} lines"
        effect = f"was not compared, for the images were not found; if they differ, it {everything}"
        yield Finding("note", name, rule, effect, "check the whole folder to compare")
    elif context.images != count:
        rule = f"one line per image; {count} lines for {context.images} files in images"
        yield Finding("error", name, rule, everything, f"remove the surplus, or {_REPAIR}")


def _about_exposures(name: str, exposures: FloatArray, context: Context) -> Iterator[Finding]:
    bad = ~np.isfinite(exposures) | (exposures < 0)
    if bad.any():
        yield Finding(
            "error",
            name,
            f"exposures are positive; {_places(bad)} negative or not a number",
            "leaves those images uncorrected, or carries NaN into its brightness transfer",
            _REPAIR,
        )
    zero = exposures == 0
    if not zero.any():
        return
    if context.program == "mono":
        rule, effect = f"exposures are positive; {_places(zero)} zero or missing", "passes the zeros on"
        yield Finding("error", name, rule, effect, _REPAIR)
        return
    left = neighbour_filled(exposures) == 0
    if left.any():
        rule = f"a zero exposure has a positive neighbour; {_places(left)} without"
        effect = "drops the exposures of all images"
        remedy = "record exposures, and leave the third column out altogether if there are none"
        yield Finding("error", name, rule, effect, remedy if left.all() else _REPAIR)
    if not left.all():
        rule = f"exposures are positive; {_places(zero)} zero or missing"
        yield Finding("warning", name, rule, "replaces them by the mean of their neighbours", _REPAIR)


def _about_units(name: str, lines: TimesLines) -> Iterator[Finding]:
    exposures = lines.exposures_ms[np.isfinite(lines.exposures_ms) & (lines.exposures_ms > 0)]
    if exposures.size and not _IN_MS[0] <= float(np.median(exposures)) <= _IN_MS[1]:
        median = float(np.median(exposures))
        unit = "seconds" if median < _IN_MS[0] else "microseconds"
        yield Finding(
            "warning",
            name,
            f"exposures are in milliseconds; their median is {median:g}, as if they were in {unit}",
            "uses only their ratios and does not notice",
            "convert them",
        )
    if exposures.size > 2 and exposures.min() == exposures.max():
        effect = "gains nothing from them, and no response can be calibrated"
        yield Finding("note", name, f"exposures vary; all are {exposures[0]:g} ms", effect)
    steps = np.diff(lines.stamps_s)
    if steps.size and not np.all(steps > 0):
        rule = f"time stamps increase; after line {int(np.argmin(steps > 0)) + 1} they do not"
        yield Finding("warning", name, rule, "plays the images in order and writes stamps that do not increase")
    elif steps.size and (advance := float(np.median(steps))) > _LONGEST_PAUSE_S:
        rule = f"time stamps are in seconds; they advance by {advance:g}, as if in milli- or nanoseconds"
        effect = "cannot play them in real time, nor can they be matched with a truth"
        yield Finding("warning", name, rule, effect, "convert them")


def _places(where: BoolArray) -> str:
    count = int(np.count_nonzero(where))
    return f"{count} of {where.size} are, first in row {int(np.argmax(where)) + 1},"
