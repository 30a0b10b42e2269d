"""Lists of exposures: ``times.txt``, ``image_list.txt``, and delimited text with a header that names the columns."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, RecordingError, SettingError, counted, quoted
from ospc.recording.exposure_units import ExposureUnit, GainUnit, in_seconds, infer_unit
from ospc.recording.frame_table import FrameTable, at_lines, make_table
from ospc.recording.list_columns import Columns, Rows, columns_of
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.table_text import lines_of, parse_number, read_table_text

IMAGE_LIST = "image_list.txt"
"""Name of the list of a static exposure series."""

_LONG_EXPOSURE = 1.5
"""Ratio of exposure to frame interval above which the unit of ``times.txt`` is doubtful; it allows for jitter."""

_INVERSE_TOLERANCE = 0.01
"""Relative rounding error allowed between an exposure time and its inverse in ``image_list.txt``."""

_TIMES_LINE = "a line is 'id stamp[s] exposure[ms]'"
_IMAGE_LIST_LINE = "a line is 'file exposure[s] 1/exposure'"


def read_list(path: Path, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Read an ``image_list.txt``, or a list with columns if it has another name; errors as :func:`parse_columns`."""
    text = read_table_text(path)
    return parse_image_list(text, str(path)) if path.name == IMAGE_LIST else parse_columns(text, str(path), options)


def read_times(path: Path, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Read the ``times.txt`` of a TUM data set: ``id stamp[s] exposure[ms]`` per line.

    Raises
    ------
    RecordingError
        If the file cannot be read or a line is malformed.
    ExposureError
        If exposures are missing or not positive.
    """
    return parse_times(read_table_text(path), str(path), options)


def parse_times(text: str, source: str, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Parse the content of a ``times.txt``, named ``source`` in messages; see :func:`read_times`."""
    rows = _uncommented(text, source)
    if options.unknown_exposures:
        rows = [(line, [*fields[:2], "1"] if len(fields) in (2, 3) else fields) for line, fields in rows]
    if rows and all(len(fields) == 2 for _, fields in rows):
        raise ExposureError(
            f"{source}: has no exposures, only ids and time stamps; calibration needs a third column with the "
            f"exposure of each frame in milliseconds"
        )
    for line, fields in rows:
        if len(fields) == 2:
            raise ExposureError(f"{source}, line {line}: has no exposure; {_TIMES_LINE}")
        if len(fields) != 3:
            raise RecordingError(f"{source}, line {line}: has {counted(len(fields), 'column')}, not 3; {_TIMES_LINE}")
    columns = Columns(3, image=0, stamp=1, exposure=2, unit=ExposureUnit.MS)
    table = _table(columns, rows, source, options)
    interval_ms = 1e3 * float(np.median(np.diff(table.stamps_s))) if len(table) > 1 else math.inf
    middle_ms = float(np.nanmedian(table.exposures_ms))
    if middle_ms <= _LONG_EXPOSURE * interval_ms:
        return table
    remark = (
        f"{source}: exposures of {middle_ms:.4g} ms are longer than the {interval_ms:.4g} ms between frames; "
        f"if they are in µs, add --exposure-unit us"
    )
    return replace(table, notes=(*table.notes, remark))


def parse_image_list(text: str, source: str) -> FrameTable:
    """Parse the ``image_list.txt`` of a static exposure series.

    Columns are ``file exposure[s] 1/exposure[1/s]``, optionally followed by f-stop, gain and neutral density.

    Raises
    ------
    RecordingError
        If a line is malformed.
    ExposureError
        If exposures are missing or invalid, or settings other than the exposure time vary.
    """
    rows = _uncommented(text, source)
    settings: list[float] | None = None
    for line, fields in rows:
        place = f"{source}, line {line}"
        if len(fields) == 1:
            raise ExposureError(f"{place}: has no exposure; {_IMAGE_LIST_LINE}")
        exposure_s = parse_number(fields[1], "the exposure", place)
        others = [parse_number(field, "every further column", place) for field in fields[2:]]
        # The inverse confirms that the column holds exposure times in seconds.
        if others and abs(exposure_s * others[0] - 1) >= _INVERSE_TOLERANCE:
            raise ExposureError(
                f"{place}: the exposure {exposure_s:g} s contradicts its inverse {others[0]:g}; {_IMAGE_LIST_LINE}"
            )
        settings = others[1:] if settings is None else settings
        if others[1:] != settings:
            raise ExposureError(
                f"{place}: f-stop, gain or filter differ from the first image; keep only images that differ in "
                f"exposure time, or list exposures in a CSV file 'file,exposure_s'"
            )
    columns = Columns(2, image=0, exposure=1, unit=ExposureUnit.S, notes=("exposures are in seconds",))
    return _table(columns, [(line, fields[:2]) for line, fields in rows], source, DEFAULT)


def parse_columns(text: str, source: str, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Parse a list of exposures with columns.

    Fields are separated by commas, semicolons, tabs or spaces. The header is the first line, or the last comment
    line before the data. Without a header, lines are ``id stamp[s] exposure[ms]``, ``file exposure[ms]`` or
    ``exposure[ms]``.

    Raises
    ------
    RecordingError
        If a line is malformed.
    ExposureError
        If exposures are missing, ambiguous or not positive.
    """
    return _table(*columns_of(text, source), source, options)


def _uncommented(text: str, source: str) -> Rows:
    return [(number, line.split()) for number, line in lines_of(text, source) if not line.startswith("#")]


def _table(columns: Columns, rows: Rows, source: str, options: ReadingOptions) -> FrameTable:
    """Turn fields into frames."""
    if columns.exposure is None:
        raise ExposureError(
            f"{source}: it is unclear which of the {columns.count} columns has the exposures; name the columns in "
            f"the first line, such as 'file,timestamp_s,exposure_ms'"
        )
    if options.gain_unit not in (None, GainUnit.NONE) and not columns.gains:
        raise SettingError(f"{source}: has no gains; leave out --gain-unit")
    for line, fields in rows:
        if len(fields) != columns.count:
            raise RecordingError(
                f"{source}, line {line}: has {counted(len(fields), 'column')}, but the others have "
                f"{columns.count}; correct it"
            )
    values = _numbers(rows, columns.exposure, "the exposure", source)
    stamps_s, stamp_notes = np.arange(len(rows), dtype=np.float64), list[str]()
    with np.errstate(over="ignore", invalid="ignore"):
        if columns.stamp is not None:
            stamps = _numbers(rows, columns.stamp, "the time stamp", source)
            stated = columns.stamp_unit or ExposureUnit.S
            in_s = stamps if stated is ExposureUnit.S else 1e-3 * stated.to_ms(stamps)
            stamps_s, stamp_notes = in_seconds(in_s, source, stated=columns.stamp_unit is not None)
        factors, gain_notes = _gain_factors(columns, rows, source, options.gain_unit)
        unit, unit_notes = _unit(columns, values, stamps_s, source, options)
        exposures_ms = unit.to_ms(values) * factors
    notes = [f"{source}: {note}" for note in (*columns.notes, *gain_notes, *unit_notes)]
    return make_table(
        source,
        _image_names(columns, rows, source),
        stamps_s,
        exposures_ms,
        [*notes, *stamp_notes],
        lines=[line for line, _ in rows],
        stamped=columns.stamp is not None,
    )


def _numbers(rows: Rows, column: int, what: str, source: str) -> FloatArray:
    found = [parse_number(fields[column], what, f"{source}, line {line}") for line, fields in rows]
    return np.array(found, dtype=np.float64)


def _gain_factors(columns: Columns, rows: Rows, source: str, stated: GainUnit | None) -> tuple[FloatArray, list[str]]:
    """Return the product of all gains of each row, and a note about them."""
    factors, said = np.ones(len(rows)), []
    for column, name, named_unit in columns.gains:
        unit, gains = stated or named_unit, _numbers(rows, column, f"the {name}", source)
        linear = unit.linear(gains)
        if unit is not GainUnit.DB and (bad := np.flatnonzero(linear <= 0)).size:
            raise ExposureError(
                f"{at_lines(source, [rows[i][0] for i in bad])}: the gain in column {quoted(name)} is "
                f"{gains[bad[0]]:g}, but it is a factor and must be positive; add --gain-unit db if it is in "
                f"decibels, or --gain-unit none to ignore it"
            )
        factors = factors * linear
        said.append(f"{quoted(name)} ({unit.label})")
    used = said and stated is not GainUnit.NONE
    return factors, [f"exposures are multiplied by the gain in {', '.join(said)}"] if used else []


def _image_names(columns: Columns, rows: Rows, source: str) -> list[str]:
    """Return the image name of every row, or its time stamp, which may be the name."""
    if columns.image is None:
        return [] if columns.stamp is None else [fields[columns.stamp] for _, fields in rows]
    names = [PurePosixPath(fields[columns.image].replace("\\", "/")).name for _, fields in rows]
    if "" in names:
        line = rows[names.index("")][0]
        raise RecordingError(f"{source}, line {line}: does not name its image; correct the line")
    return names


def _unit(
    columns: Columns, values: FloatArray, stamps_s: FloatArray, source: str, options: ReadingOptions
) -> tuple[ExposureUnit, list[str]]:
    """Return the unit from the options, from the header, or inferred from the numbers, in this order."""
    if options.exposure_unit is not None:
        return options.exposure_unit, [f"exposures are in {options.exposure_unit.value}, as stated by the user"]
    if columns.unit is not None:
        return columns.unit, []
    steps = np.diff(stamps_s) if columns.stamp is not None else np.empty(0)
    usable = len(steps) > 0 and np.all(np.isfinite(steps))
    interval_ms = 1e3 * float(np.median(steps)) if usable else None
    try:
        unit = infer_unit(values, interval_ms if interval_ms and interval_ms > 0 else None, source)
    except ExposureError:
        unit = ExposureUnit.MS
    how = "no other unit is stated" if unit is ExposureUnit.MS else "inferred from their size"
    return unit, [f"exposures are assumed to be in {unit.value}: {how}"]
