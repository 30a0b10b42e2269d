"""Lists of exposures other than ``times.txt``: delimited text with a header that names the columns."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from ospc.errors import ExposureError, RecordingError
from ospc.recording.column_names import Columns, name_columns
from ospc.recording.exposure_units import ExposureUnit, infer_unit
from ospc.recording.frame_table import FrameTable, Row, make_table
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.text_file import is_number, lines_of, parse_number, read_text

_LARGEST_STAMP_S = 1e11
"""Larger time stamps are not in seconds, so they do not yet give the frame rate."""

_ADVICE = "name the columns in its first line, such as 'file,timestamp_s,exposure_ms'"


def read_exposure_table(path: Path, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Read a list of exposures.

    Raises
    ------
    RecordingError
        If it cannot be read or a line breaks the format; the message names the line.
    ExposureError
        If exposures are missing, ambiguous or not positive.
    """
    return parse_exposure_table(read_text(path), str(path), options)


def names_exposures(path: Path) -> bool:
    """Tell whether a file is a list of exposures: its header, commented out or not, names a column of exposures."""
    try:
        layout = _layout(read_text(path), str(path))
    except ExposureError:
        return True
    except RecordingError:
        return False
    return layout.named and layout.columns.exposure is not None


def parse_exposure_table(text: str, source: str, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Parse a list of exposures.

    Fields are separated by commas, semicolons, tabs or spaces. The header is the first line, or the last comment
    line before the data; without a header, lines are ``id stamp[s] exposure[ms]``, ``file exposure[ms]`` or
    ``exposure[ms]``.

    Parameters
    ----------
    text
        Content of the file.
    source
        Name of the file in messages.
    options
        What the user states about units.

    Raises
    ------
    RecordingError
        If a line breaks the format; the message names it.
    ExposureError
        If exposures are missing, ambiguous or not positive.
    """
    layout = _layout(text, source)
    columns = layout.columns
    if columns.exposure is None:
        raise ExposureError(
            f"{source}: it is unclear which of its {columns.count} columns holds exposures; {_ADVICE}"
        )
    rows = []
    values, factors = [], []
    for index, (line, fields) in enumerate(layout.rows):
        place = f"{source}, line {line}"
        if len(fields) != columns.count:
            raise RecordingError(
                f"{place}: has {len(fields)} columns where the others have {columns.count}; correct it"
            )
        values.append(parse_number(fields[columns.exposure], "the exposure", place))
        factor = 1.0
        for gain in columns.gains:
            value = parse_number(fields[gain.column], f"the {gain.name}", place)
            factor *= gain.linear(value, options.gain_unit)
        factors.append(factor)
        stamp_s = float(index)
        image = ""
        if columns.stamp is not None:
            stamp_s = parse_number(fields[columns.stamp], "the time stamp", place) * columns.to_s
            image = fields[columns.stamp]
        if columns.image is not None:
            image = PurePosixPath(fields[columns.image].replace("\\", "/")).name
            if not image:
                raise RecordingError(f"{place}: does not name its image; correct the line")
        rows.append(Row(line, image, stamp_s, 0.0))
    unit, unit_notes = _unit(layout, values, [row.stamp_s for row in rows], source, options)
    exposures_ms = unit.to_ms(np.array(values, dtype=np.float64)) * np.array(factors, dtype=np.float64)
    rows = [row._replace(exposure_ms=float(exposure_ms)) for row, exposure_ms in zip(rows, exposures_ms, strict=True)]
    notes = [f"{source}: {note}" for note in (*columns.notes, *unit_notes)]
    return make_table(source, rows, notes, stamped=columns.stamp is not None)


@dataclass(frozen=True)
class _Layout:
    """The rows of a file, split into fields, and the meaning of its columns; named if there is a header."""

    columns: Columns
    rows: list[tuple[int, list[str]]]
    named: bool = True


def _layout(text: str, source: str) -> _Layout:
    lines = lines_of(text, source)
    start = next((i for i, (_, line) in enumerate(lines) if not line.startswith("#")), None)
    if start is None:
        raise RecordingError(f"{source}: holds no frames; it needs one line per image")
    separator = _separator(lines[start][1])
    rows = [(n, _fields(line, separator, f"{source}, line {n}")) for n, line in lines[start:] if line[0] != "#"]
    if not any(is_number(field) for field in rows[0][1]):
        return _Layout(name_columns(rows[0][1], f"{source}, line {rows[0][0]}"), rows[1:])
    count = len(rows[0][1])
    if start > 0:
        number, comment = lines[start - 1]
        heading = _fields(comment.lstrip("# "), separator, f"{source}, line {number}")
        if len(heading) == count:
            columns = name_columns(heading, f"{source}, line {number}")
            if columns.exposure is not None:
                return _Layout(columns, rows)
    return _Layout(_unnamed(rows[0][1], source), rows, named=False)


def _unit(
    layout: _Layout, values: Sequence[float], stamps_s: Sequence[float], source: str, options: ReadingOptions
) -> tuple[ExposureUnit, list[str]]:
    """Return the unit that is stated, that is in the header, or that fits the numbers, in this order."""
    if options.exposure_unit is not None:
        return options.exposure_unit, [f"exposures are in {options.exposure_unit.value}, as stated"]
    if layout.columns.unit is not None:
        return layout.columns.unit, []
    steps = np.diff(np.asarray(stamps_s)) if layout.columns.stamp is not None else np.empty(0)
    usable = len(steps) > 0 and np.all(np.isfinite(steps)) and abs(stamps_s[0]) < _LARGEST_STAMP_S
    interval_ms = 1e3 * float(np.median(steps)) if usable else None
    try:
        unit = infer_unit(values, interval_ms if interval_ms and interval_ms > 0 else None, source)
    except ExposureError:
        unit = ExposureUnit.MS
    how = "no other unit is stated" if unit is ExposureUnit.MS else "by their size"
    return unit, [f"exposures are taken as {unit.value}: {how}"]


def _unnamed(fields: list[str], source: str) -> Columns:
    """Infer the columns of a file without header from their number and the first row."""
    count = len(fields)
    if count == 3:
        said = ("columns are taken as id, stamp[s], exposure",)
        return Columns(count, image=0, stamp=1, exposure=2, notes=said)
    if count == 2 and not is_number(fields[0]):
        return Columns(count, image=0, exposure=1, notes=("columns are taken as file, exposure",))
    if count == 1:
        return Columns(count, exposure=0, notes=("its numbers are taken as exposures",))
    return Columns(count)


def _separator(line: str) -> str | None:
    return next((s for s in (";", ",", "\t") if s in line), None)


def _fields(line: str, separator: str | None, place: str) -> list[str]:
    """Split a line; units such as ``[ms]`` stay with their name."""
    if separator is None:
        return re.sub(r"\s+(?=[\[(]\w{1,3}[\])])", "", line).split()
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error as error:
        raise RecordingError(f"{place}: its quotes are wrong ({error}); correct the line") from None
