"""Lists of exposures: ``times.txt``, ``image_list.txt``, and delimited text with a header that names the columns."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, RecordingError, SettingError, counted, plain, quoted
from ospc.recording.exposure_units import (
    SHORTEST_MS,
    ExposureUnit,
    GainUnit,
    in_seconds,
    infer_unit,
    interval_ms,
    known_gain_unit,
)
from ospc.recording.frame_matching import file_name, frame_numbers, image_column
from ospc.recording.frame_table import FrameTable, at_lines, make_table
from ospc.recording.list_columns import Columns, Rows, columns_of, gain_unit_note
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.table_text import is_fraction, lines_of, parse_exposure, parse_number, read_table_text

IMAGE_LIST = "image_list.txt"
"""Name of the list of a static exposure series."""

_LONG_EXPOSURE = 1.5
"""Ratio of exposure to frame interval above which the unit of ``times.txt`` is doubtful; it allows for jitter."""

_INVERSE_TOLERANCE = 0.01
"""Relative rounding error allowed between an exposure time and its inverse in ``image_list.txt``."""

_TIMES_LINE = "a line is 'id stamp[s] exposure[ms]'"
_IMAGE_LIST_LINE = "a line is 'file exposure[s] 1/exposure'"


def read_list(
    path: Path, options: ReadingOptions = DEFAULT, *, images: Sequence[str] = (), numbered: bool = False
) -> FrameTable:
    """Read a list with columns, or the ``image_list.txt`` of a static exposure series.

    Columns are described in :mod:`~ospc.recording.list_columns`. Those of an ``image_list.txt`` are
    ``file exposure[s] 1/exposure[1/s]``, optionally followed by f-stop, gain and neutral density.

    Parameters
    ----------
    path, options
        The list, and what the user states about it.
    images
        File names of the images of the recording: a column with these names is used whatever its header is.
    numbered
        Whether frames have numbers instead of names, as in a video; rows are then sorted by the number of the frame.

    Raises
    ------
    RecordingError
        If the file cannot be read or a line is malformed.
    ExposureError
        If exposures are missing, ambiguous or not positive, or a gain or another setting changes that is not used.
    """
    text, source = read_table_text(path), str(path)
    if path.name == IMAGE_LIST:
        return _image_list(text, source)
    return _table(*columns_of(text, source), source, options, images, numbered=numbered)


def read_times(path: Path, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Read the ``times.txt`` of a TUM data set: ``id stamp[s] exposure[ms]`` per line.

    Raises
    ------
    RecordingError
        If the file cannot be read or a line is malformed.
    ExposureError
        If exposures are missing or not positive.
    """
    source = str(path)
    rows = _uncommented(read_table_text(path), source)
    if options.unknown_exposures:
        rows = [(line, [*fields[:2], "1"] if len(fields) in (2, 3) else fields) for line, fields in rows]
    for line, fields in rows:
        if len(fields) == 2:
            raise ExposureError(f"{source}, line {line}: has no exposure; {_TIMES_LINE}")
        if len(fields) != 3:
            raise RecordingError(f"{source}, line {line}: has {counted(len(fields), 'column')}, not 3; {_TIMES_LINE}")
    columns = Columns(3, image=0, stamp=1, exposure=2, unit=ExposureUnit.MS)
    table = _table(columns, rows, source, options)
    return table if options.exposure_unit else replace(table, notes=(*table.notes, *_doubts(table)))


def _doubts(table: FrameTable) -> list[str]:
    """Return a note if exposures are not plausible in ms: they are longer than the time between frames, or tiny."""
    between_ms = interval_ms(table.stamps_s)
    middle_ms = float(np.nanmedian(table.exposures_ms))
    if SHORTEST_MS <= middle_ms <= _LONG_EXPOSURE * between_ms:
        return []
    try:
        unit = infer_unit(table.exposures_ms, table.stamps_s, table.source).value
        remedy = f"if they are in {unit}, add --exposure-unit {unit}"
    except ExposureError:
        remedy = "check the column, or give their unit with --exposure-unit"
    why = "very short" if middle_ms < SHORTEST_MS else f"longer than the {plain(between_ms)} ms between frames"
    return [f"{table.source}: exposures of {plain(middle_ms)} ms are {why}; {remedy}"]


def _image_list(text: str, source: str) -> FrameTable:
    """Parse an ``image_list.txt``."""
    rows = _uncommented(text, source)
    settings: list[float] | None = None
    for line, fields in rows:
        place = f"{source}, line {line}"
        if len(fields) == 1:
            raise ExposureError(f"{place}: has no exposure; {_IMAGE_LIST_LINE}")
        exposure_s = parse_exposure(fields[1], place, seconds=True)
        others = [parse_number(field, "every further column", place) for field in fields[2:]]
        # The inverse confirms that the column holds exposure times in seconds.
        if others and abs(exposure_s * others[0] - 1) >= _INVERSE_TOLERANCE:
            raise ExposureError(
                f"{place}: the exposure {exposure_s:g} s contradicts its inverse {others[0]:g}; {_IMAGE_LIST_LINE}"
            )
        settings = others[1:] if settings is None else settings
        if not np.array_equal(others[1:], settings, equal_nan=True):
            raise ExposureError(
                f"{place}: f-stop, gain or filter differ from the first image; keep only images that differ in "
                f"exposure time, or list exposures in a CSV file 'file,exposure_s'"
            )
    columns = Columns(2, image=0, exposure=1, unit=ExposureUnit.S, notes=("exposures are in seconds",))
    return _table(columns, [(line, fields[:2]) for line, fields in rows], source, DEFAULT)


def _uncommented(text: str, source: str) -> Rows:
    return [(number, line.split()) for number, line in lines_of(text, source) if not line.startswith("#")]


def _table(
    columns: Columns,
    rows: Rows,
    source: str,
    options: ReadingOptions,
    images: Sequence[str] = (),
    *,
    numbered: bool = False,
) -> FrameTable:
    """Turn fields into frames; see :func:`read_list`."""
    _check(columns, rows, source, options)
    texts = [[fields[column] for _, fields in rows] for column in range(columns.count)]
    if images:
        columns = replace(columns, image=image_column(columns, texts, images))
    elif numbered and columns.image is not None and (numbers := frame_numbers(texts[columns.image])):
        rows = [rows[i] for i in np.argsort(numbers, kind="stable")]
    stamps_s, stamp_notes = np.arange(len(rows), dtype=np.float64), list[str]()
    with np.errstate(over="ignore", invalid="ignore"):
        if columns.stamp is not None:
            stamps = _numbers(rows, columns.stamp, "the time stamp", source)
            stated = columns.stamp_unit or ExposureUnit.S
            in_s = stamps if stated is ExposureUnit.S else 1e-3 * stated.to_ms(stamps)
            stamps_s, stamp_notes = in_seconds(in_s, source, stated=columns.stamp_unit is not None)
        factors, gain_notes = _gain_factors(columns, rows, source, options.gain_unit)
        times_s = stamps_s if columns.stamp is not None else stamps_s[:0]
        times_ms, unit_notes = _in_ms(columns, rows, times_s, source, options.exposure_unit)
        exposures_ms = times_ms * factors
    if columns.aperture is not None and len(set(texts[columns.aperture])) > 1:
        gain_notes.append("the f-number changes, and with it exposure and vignette; keep images of one f-number")
    notes = [f"{source}: {note}" for note in (*columns.notes, *gain_notes, *unit_notes)]
    return make_table(
        source,
        [] if numbered and columns.image is None else _image_names(columns, rows, source),
        stamps_s,
        exposures_ms,
        [*notes, *stamp_notes],
        lines=[line for line, _ in rows],
        stamped=columns.stamp is not None,
    )


def _check(columns: Columns, rows: Rows, source: str, options: ReadingOptions) -> None:
    """Raise an error if there are no exposures, rows of other lengths, or gains that nothing says how to use."""
    if columns.exposure is None:
        raise ExposureError(
            f"{source}: it is unclear which of the {columns.count} columns has the exposures; name the columns in "
            f"the first line, such as 'file,timestamp_s,exposure_ms'"
        )
    for line, fields in rows:
        if len(fields) != columns.count:
            raise RecordingError(
                f"{source}, line {line}: has {counted(len(fields), 'column')}, but the others have "
                f"{columns.count}; correct it"
            )
    for column, name in columns.doubtful if options.gain_unit is not GainUnit.NONE else ():
        if len({fields[column] for _, fields in rows}) > 1:
            raise ExposureError(
                f"{source}: the column {quoted(name)} looks like a gain and changes, but it is not used; rename it "
                f"to gain, gain_db or iso if exposures must be multiplied by it, remove it if not, or add "
                f"--gain-unit none to ignore all gains"
            )
    if options.gain_unit not in (None, GainUnit.NONE) and not columns.gains:
        raise SettingError(f"{source}: has no gains; leave out --gain-unit")


def _in_ms(
    columns: Columns, rows: Rows, stamps_s: FloatArray, source: str, stated: ExposureUnit | None
) -> tuple[FloatArray, list[str]]:
    """Return the exposures without gain, and notes about their unit."""
    unit, texts = stated or columns.unit, [fields[columns.exposure or 0] for _, fields in rows]
    seconds, places = unit in (None, ExposureUnit.S), [f"{source}, line {line}" for line, _ in rows]
    read = [parse_exposure(text, place, seconds=seconds) for text, place in zip(texts, places, strict=True)]
    values, notes = np.array(read), list[str]()
    if stated is not None:
        notes = [f"exposures are in {stated.value}, as stated by the user"]
    elif unit is None and any(map(is_fraction, texts)):
        unit, notes = ExposureUnit.S, ["exposures are in s, because some are fractions of a second"]
    if unit is None:
        unit, how = ExposureUnit.MS, "no other unit is stated"
        with suppress(ExposureError):
            unit = infer_unit(values, stamps_s, source)
        if unit is not ExposureUnit.MS:
            how = "inferred from their size"
        notes = [f"exposures are assumed to be in {unit.value}: {how}"]
    return unit.to_ms(values), notes


def _numbers(rows: Rows, column: int, what: str, source: str) -> FloatArray:
    found = [parse_number(fields[column], what, f"{source}, line {line}") for line, fields in rows]
    return np.array(found, dtype=np.float64)


def _gain_factors(columns: Columns, rows: Rows, source: str, stated: GainUnit | None) -> tuple[FloatArray, list[str]]:
    """Return the product of all gains of each row, and notes about them."""
    factors, said, notes = np.ones(len(rows)), list[str](), list[str]()
    for column, name, named_unit in columns.gains if stated is not GainUnit.NONE else ():
        gains = _numbers(rows, column, f"the {name}", source)
        known = stated or named_unit
        unit = known_gain_unit(known, gains, f"{source}: the gain in column {quoted(name)}")
        linear = unit.linear(gains)
        if unit is not GainUnit.DB and (bad := np.flatnonzero(linear <= 0)).size:
            raise ExposureError(
                f"{at_lines(source, [rows[i][0] for i in bad])}: the gain in column {quoted(name)} is "
                f"{gains[bad[0]]:g}, but it is a factor and must be positive; add --gain-unit db if it is in "
                f"decibels, or --gain-unit none to ignore it"
            )
        factors = factors * linear
        if known is None:
            notes.append(f"the gain in {quoted(name)} is constant and ignored")
        else:
            said.append(quoted(name) + gain_unit_note(name, unit, stated=stated is not None))
    used = [f"exposures are multiplied by the gain in {', '.join(said)}"] if said else []
    return factors, used + notes


def _image_names(columns: Columns, rows: Rows, source: str) -> list[str]:
    """Return the image name of every row, or its time stamp, which may be the name."""
    if columns.image is None:
        return [] if columns.stamp is None else [fields[columns.stamp] for _, fields in rows]
    names = [file_name(fields[columns.image]) for _, fields in rows]
    if "" in names:
        line = rows[names.index("")][0]
        raise RecordingError(f"{source}, line {line}: does not name its image; correct the line")
    return names
