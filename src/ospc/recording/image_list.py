"""``image_list.txt`` of static exposure series: file name, exposure time and its inverse.

Columns are ``file exposure[s] 1/exposure[1/s]``, optionally followed by f-stop, gain and neutral density.
"""

from __future__ import annotations

from pathlib import Path

from ospc.errors import ExposureError
from ospc.recording.frame_table import FrameTable, Row, make_table
from ospc.recording.text_file import lines_of, parse_number, read_text

_INVERSE_TOLERANCE = 0.01
"""Relative rounding error allowed between an exposure time and its inverse."""

_LAYOUT = "a line is 'file exposure[s] 1/exposure'"


def read_image_list(path: Path) -> FrameTable:
    """Read an ``image_list.txt``.

    Raises
    ------
    RecordingError
        If it cannot be read or a line breaks the format; the message names the line.
    ExposureError
        If exposures are missing or invalid, or other settings than the exposure time vary.
    """
    return parse_image_list(read_text(path), str(path))


def parse_image_list(text: str, source: str) -> FrameTable:
    """Parse the content of an ``image_list.txt``; see :func:`read_image_list`."""
    rows: list[Row] = []
    settings: list[float] | None = None
    for line, content in lines_of(text, source):
        if content.startswith("#"):
            continue
        place = f"{source}, line {line}"
        fields = content.split()
        if len(fields) == 1:
            raise ExposureError(f"{place}: has no exposure; {_LAYOUT}")
        exposure_s = parse_number(fields[1], "the exposure", place)
        others = [parse_number(field, "every further column", place) for field in fields[2:]]
        # The inverse confirms that the column holds exposure times in seconds.
        if others and not abs(exposure_s * others[0] - 1) < _INVERSE_TOLERANCE:
            raise ExposureError(
                f"{place}: the exposure {exposure_s:g} s contradicts its inverse {others[0]:g}; {_LAYOUT}"
            )
        if settings is None:
            settings = others[1:]
        if others[1:] != settings:
            raise ExposureError(
                f"{place}: f-stop, gain or filter differ from those of the first image; keep images that differ in "
                f"exposure time only, or list their exposures in a CSV file 'file,exposure_s'"
            )
        rows.append(Row(line, fields[0], float(len(rows)), exposure_s * 1000))
    return make_table(source, rows, (f"{source}: exposures are in seconds",), stamped=False)
