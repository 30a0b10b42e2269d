"""The rules for pcalib.txt: the inverse response as a table on one line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ospc.arrays import Float32Array, FloatArray
from ospc.errors import FormatError, counted
from ospc.formats.files import BYTE_ORDER_MARK, read_text, write_text
from ospc.formats.rules import MOST_INTERPOLATED, UNCORRECTED, Broken, Context, Format, Severity, mark_before
from ospc.formats.scanning import NUMBER, leading_numbers, words_of

FEWEST_VALUES = 256
"""DSO needs at least this many values, and the tools of the monocular data set exactly this many."""

MOST_VALUES = 65536
"""DSO has memory for this many values."""

MOST_COLUMNS = 16
"""Maximum number of values in a line of a camera.txt or times.txt; a longer line is the table of a response."""

_SMALLEST_POSITIVE = np.float32(1e-30)
"""Lower limit of positive values: some parsers reject subnormal numbers, which are smaller than 1.2e-38."""


@dataclass(frozen=True)
class PcalibText:
    """The text of a pcalib.txt, as the programs read it."""

    text: str

    @property
    def first_line(self) -> str:
        """The line that the programs read."""
        return self.text.removeprefix(BYTE_ORDER_MARK).split("\n", 1)[0]

    @property
    def other_lines(self) -> list[str]:
        """The lines after the first, without blank ones."""
        return [line.strip() for line in self.text.split("\n")[1:] if line.strip()]

    @cached_property
    def scanned(self) -> tuple[FloatArray, str]:
        """The numbers that a program reads from the first line, shape (values,), and the text that stops it."""
        numbers, rest = leading_numbers(self.first_line)
        with np.errstate(over="ignore"):
            too_large = np.flatnonzero(~np.isfinite(numbers.astype(np.float32)))
        if too_large.size:  # a stream also stops at a number that overflows its type
            return numbers[: too_large[0]], f"{numbers[too_large[0]]:g}"
        return numbers, rest

    @property
    def values(self) -> Float32Array:
        """The table as the programs store it, shape (values,)."""
        return self.scanned[0].astype(np.float32)


def strictly_increasing_float32(values: npt.ArrayLike) -> Float32Array:
    """Return the closest strictly increasing curve in 32-bit floats to a non-decreasing one from 0 to 255.

    Neighbours that are equal in 32 bits are moved, each by as few representable steps as possible for the one that
    moves most; all other values stay. Subnormal numbers are avoided because some parsers reject them.
    """
    rounded = np.clip(np.asarray(values, dtype=np.float64), 0.0, 255.0).astype(np.float32)
    # Non-negative floats sort like integers with the same bits, and adjacent floats are adjacent integers.
    index = np.arange(rounded.size)
    slack = rounded.view(np.int32) - index
    # Halfway between the largest value so far and the smallest from here on: isotonic regression in the maximum norm.
    halfway = (np.maximum.accumulate(slack) + np.minimum.accumulate(slack[::-1])[::-1]) / 2
    least, most = _SMALLEST_POSITIVE.view(np.int32) - 1, np.float32(255).view(np.int32) - index[-1]
    spread = np.round(np.clip(halfway, least, most)).astype(np.int32) + index
    spread[0], spread[-1] = 0, np.float32(255).view(np.int32)
    return np.asarray(spread.astype(np.int32).view(np.float32))


def table_text(values: npt.ArrayLike) -> str:
    """Return a non-decreasing curve as the text of a pcalib.txt, scaled to 0..255, with nine significant digits."""
    curve = np.asarray(values, dtype=np.float64)
    table = strictly_increasing_float32(255 * ((curve - curve[0]) / (curve[-1] - curve[0])))
    return " ".join(f"{value:.9g}" for value in table) + "\n"


_LARGEST_VALUE = 1e30
"""Larger values count as missing: values and their differences must not exceed 3.4e38, the largest 32-bit float."""

_MOSTLY, _CLEARLY = 0.95, 0.02
"""Share of the grey levels at which a response lies above the diagonal, and its mean height above it as a fraction of
the range: the inverse response of nearly all cameras is below it, or close to it if they are almost linear."""

_DECIMAL_COMMA = re.compile(r"(?:^|\s)[+-]?\d+,\d+(?:\s|$)", re.ASCII)
_DECIMAL_POINTS = "write decimal points, and spaces between values"


def _has_decimal_commas(line: str) -> bool:
    return _DECIMAL_COMMA.search(line) is not None


def _about_the_mark(table: PcalibText, _context: Context) -> Iterator[Broken]:
    return mark_before(table.text, "stops reading there, after 0 values", PcalibText)


def _about_the_line(table: PcalibText, context: Context) -> Iterator[Broken]:
    (values, rest), extra = table.scanned, table.other_lines
    complete = values.size >= FEWEST_VALUES
    severity: Severity = "warning" if complete else "error"
    if extra:
        rule = f"all values must be on one line; {counted(len(extra), 'line')} too many, the first {extra[0][:30]!r}"
        effect = "only reads the first line; programs that read the entire file fail or read too many values"
        yield Broken(severity, rule, effect, "put all values on the first line", _put_on_one_line)
    if rest:
        rule = f"only numbers, separated by spaces; value {values.size + 1} is {rest.split()[0][:20]!r}"
        effect = f"stops reading there, after {counted(values.size, 'value')}"
        remedy = "write only the values on the first line, separated by spaces"
        if _has_decimal_commas(table.first_line):
            remedy = _DECIMAL_POINTS
        yield Broken(severity, rule, effect, remedy, _keep_numbers_only)
    if not complete:
        wanted = "exactly" if context.program == "mono" else "at least"
        rule = f"{wanted} {FEWEST_VALUES} values on the first line; there are {values.size}"
        remedy = "write the value of every grey level, separated by spaces"
        yield Broken("error", rule, UNCORRECTED[context.program], remedy)


def _about_the_order(table: PcalibText, context: Context) -> Iterator[Broken]:
    values = table.values
    steps = np.diff(values)
    bad = np.flatnonzero(steps <= 0)
    if bad.size:
        falls = int(np.count_nonzero(steps < 0))
        found = f"{counted(falls, 'value')} decreasing, {bad.size - falls} equal to the previous one"
        rule = f"strictly increasing as 32-bit floats; after grey level {bad[0]} it is not ({found})"
        remedy = "calibrate again" if falls else "write 9 significant digits"
        yield Broken("error", rule, UNCORRECTED[context.program], remedy, _make_increasing)
    if _increases(values):
        span = float(values[-1]) - float(values[0])
        steps = np.diff((255.0 * (values - values[0]).astype(np.float64) / span).astype(np.float32))
        if not np.all(steps > 0):
            rule = f"strictly increasing after scaling to 0..255; after grey level {int(np.argmin(steps))} it is not"
            effect = "loads it, and divides by zero when it inverts the curve there"
            yield Broken(
                "warning", rule, effect, "write values from 0 to 255 with 9 significant digits", _scale_to_255
            )


def _about_the_count(table: PcalibText, context: Context) -> Iterator[Broken]:
    count = table.values.size
    remedy = f"write the {FEWEST_VALUES} values of an 8-bit camera"
    if count <= FEWEST_VALUES:
        return
    if context.program == "mono":
        rule = f"exactly {FEWEST_VALUES} values on the first line; there are {count}"
        yield Broken("error", rule, UNCORRECTED["mono"], remedy, _resample_to_8_bit)
    elif count > MOST_VALUES:
        rule = f"at most {MOST_VALUES} values, the limit of its memory; there are {count}"
        yield Broken("error", rule, UNCORRECTED["dso"], remedy, _resample_to_8_bit)
    else:
        rule = f"{count} values, for images with this many grey levels"
        beyond = (
            f"; those written by 'ospc convert' have grey values beyond {count - 1}" if count < MOST_VALUES else ""
        )
        effect = (
            f"accepts them, but its image reader delivers 8 bits and only uses the first {FEWEST_VALUES}, which "
            f"are almost black; this only works in builds that read deeper images{beyond}"
        )
        yield Broken("warning", rule, effect, remedy, _resample_to_8_bit)


def _about_the_range(table: PcalibText, _context: Context) -> Iterator[Broken]:
    values = table.values
    if not _increases(values):
        return
    if values[0] != 0 or values[-1] != 255:
        rule = f"values run from {values[0]:g} to {values[-1]:g}"
        effect = (
            "scales them to 0..255" if values[0] == 0 else "shifts and scales them to 0..255, losing a black level"
        )
        yield Broken("note", rule, effect, repair=_scale_to_255)


def _about_the_direction(table: PcalibText, _context: Context) -> Iterator[Broken]:
    values = table.values.astype(np.float64)
    if values.size < FEWEST_VALUES or not _increases(table.values):
        return
    above = (values - values[0]) / (values[-1] - values[0]) - np.linspace(0, 1, values.size)
    if np.mean(above[1:-1] > 0) >= _MOSTLY and np.mean(above) > _CLEARLY:
        rule = "the inverse of the response, the irradiance at each grey level; these values look like the response"
        effect = "applies the response a second time instead of removing it"
        yield Broken("warning", rule, effect, "write the inverse function of this table")


def _put_on_one_line(table: PcalibText, _context: Context) -> tuple[PcalibText, str]:
    extra = table.other_lines
    if len(words_of(table.first_line)) <= 1 and len(extra) + 1 >= FEWEST_VALUES:
        joined = " ".join([table.first_line.strip(), *extra])
        return PcalibText(joined), f"put the values of {len(extra) + 1} lines on one line"
    return PcalibText(table.first_line), f"dropped everything after the first line, beginning with {extra[0][:30]!r}"


def _keep_numbers_only(table: PcalibText, _context: Context) -> tuple[PcalibText, str]:
    """Interpolate values such as nan, drop other words, and drop all text after a complete table."""
    if _has_decimal_commas(table.first_line):
        raise FormatError(_DECIMAL_POINTS)
    words = words_of(table.first_line)
    numbers = [float(word) if NUMBER.fullmatch(word) else None for word in words]
    changes = ["replaced commas or semicolons by spaces"] if re.search("[,;]", table.first_line) else []
    end = next((i for i, number in enumerate(numbers) if number is None), len(words))
    if FEWEST_VALUES <= end < len(words):  # a remark, including any numbers in it
        changes.append(f"dropped the text after value {end}: {' '.join(words[end:])[:30]!r}")
        words, numbers = words[:end], numbers[:end]
    texts = [word for word, number in zip(words, numbers, strict=True) if number is None]
    if texts:
        changes.append(f"dropped words that are not numbers: {' '.join(texts)[:30]!r}")
    values = np.array([number for number in numbers if number is not None], dtype=np.float64)
    known = np.abs(values) < _LARGEST_VALUE
    if not known.all():
        if not (known[0] and known[-1]) or np.mean(~known) > MOST_INTERPOLATED:
            raise FormatError("the first value, the last value, or too many values are not finite; calibrate again")
        values[~known] = np.interp(np.flatnonzero(~known), np.flatnonzero(known), values[known])
        changes.append(f"interpolated {counted(np.count_nonzero(~known), 'non-finite value')}")
    return PcalibText(" ".join(f"{value:.17g}" for value in values)), "; ".join(changes)


def _make_increasing(table: PcalibText, _context: Context) -> tuple[PcalibText, str]:
    """Replace the table by the closest increasing one in the least squares sense."""
    from scipy.optimize import isotonic_regression  # slow to import and rarely needed

    values = table.scanned[0]
    if values[-1] <= values[0]:
        raise FormatError(
            f"decreases from {values[0]:g} to {values[-1]:g}, so it is not an inverse response; calibrate again"
        )
    monotone = np.asarray(isotonic_regression(values).x)
    span = float(monotone[-1] - monotone[0])
    moved = np.abs(monotone - values)
    falls = int(np.count_nonzero(np.diff(values) < 0))
    changes = []
    if falls:
        changes.append(
            f"removed {counted(falls, 'decreasing step')} by isotonic regression, which moves "
            f"{counted(np.count_nonzero(moved > 1e-9 * span), 'value')} by up to "
            f"{100 * float(moved.max()) / span:.3g} % of the range"
        )
    changes.append("separated values that are equal as 32-bit floats by the smallest representable steps")
    return PcalibText(table_text(monotone)), "; ".join(changes)


def _resample_to_8_bit(table: PcalibText, _context: Context) -> tuple[PcalibText, str]:
    values = table.scanned[0]
    resampled = np.interp(np.linspace(0, 1, FEWEST_VALUES), np.linspace(0, 1, values.size), values)
    change = f"resampled {values.size} values to {FEWEST_VALUES}, the table for 8-bit images"
    return PcalibText(table_text(resampled)), change


def _scale_to_255(table: PcalibText, _context: Context) -> tuple[PcalibText, str]:
    return PcalibText(table_text(table.scanned[0])), "shifted and scaled values to 0..255"


def _increases(values: Float32Array) -> bool:
    return values.size >= 2 and bool(np.all(np.diff(values) > 0))


PCALIB: Format[PcalibText] = Format(
    read=lambda path: PcalibText(read_text(path, keep_mark=True)),
    write=lambda table, path: write_text(path, table.text),
    checks=(
        _about_the_mark,
        _about_the_line,
        _about_the_order,
        _about_the_count,
        _about_the_range,
        _about_the_direction,
    ),
)
