"""``times.txt`` of the TUM monocular and TUM visual-inertial datasets: ``id stamp[s] exposure[ms]`` per line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ospc.errors import ExposureError, RecordingError
from ospc.recording.frame_table import FrameTable, Row, make_table
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.text_file import lines_of, parse_number, read_text

_COLUMNS = 3
"""Columns of a line: id, time stamp, exposure."""

_LONG_EXPOSURE = 1.5
"""Ratio of exposure to frame interval beyond which the unit is doubtful; time stamps jitter."""


def read_times(path: Path, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Read a ``times.txt``.

    Raises
    ------
    RecordingError
        If it cannot be read or a line breaks the format; the message names the line.
    ExposureError
        If exposures are missing or not positive.
    """
    return parse_times(read_text(path), str(path), options)


def parse_times(text: str, source: str, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Parse the content of a ``times.txt``; lines that start with ``#`` and blank lines are skipped.

    Parameters
    ----------
    text
        Content of the file.
    source
        Name of the file in messages.
    options
        What the user states about the unit, which is ms by default.

    Raises
    ------
    RecordingError
        If a line breaks the format; the message names it.
    ExposureError
        If exposures are missing or not positive.
    """
    rows = [(number, line.split()) for number, line in lines_of(text, source) if not line.startswith("#")]
    if options.unknown_exposures:
        rows = [(number, [*fields[:2], "1"] if len(fields) in (2, 3) else fields) for number, fields in rows]
    if rows and all(len(fields) == _COLUMNS - 1 for _, fields in rows):
        raise ExposureError(
            f"{source}: has no exposures, only ids and time stamps; calibration needs a third column with the "
            f"exposure of each frame in milliseconds"
        )
    table = []
    for number, fields in rows:
        place = f"{source}, line {number}"
        if len(fields) == _COLUMNS - 1:
            raise ExposureError(f"{place}: has no exposure; a line is 'id stamp[s] exposure[ms]'")
        if len(fields) != _COLUMNS:
            raise RecordingError(f"{place}: has {len(fields)} columns, not 3; a line is 'id stamp[s] exposure[ms]'")
        stamp_s = parse_number(fields[1], "the time stamp", place)
        table.append(Row(number, fields[0], stamp_s, parse_number(fields[2], "the exposure", place)))
    unit = options.exposure_unit
    if unit is not None and table:
        exposures_ms = unit.to_ms(np.array([row.exposure_ms for row in table]))
        table = [row._replace(exposure_ms=float(ms)) for row, ms in zip(table, exposures_ms, strict=True)]
    return _with_remark(
        make_table(source, table, [f"{source}: exposures are in {unit.value}, as stated"] if unit else [])
    )


def _with_remark(table: FrameTable) -> FrameTable:
    """Add a note if the exposures are longer than the frame interval."""
    interval_ms = 1e3 * float(np.median(np.diff(table.stamps_s))) if len(table) > 1 else math.inf
    middle_ms = float(np.median(table.exposures_ms))
    if middle_ms <= _LONG_EXPOSURE * interval_ms:
        return table
    remark = (
        f"{table.source}: exposures of {middle_ms:.4g} ms are longer than the {interval_ms:.4g} ms between frames; "
        f"if they are in µs, state --exposure-unit us"
    )
    return replace(table, notes=(*table.notes, remark))
