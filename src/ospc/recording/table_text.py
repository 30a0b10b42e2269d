"""Text files with tables of frames: their lines, and the numbers in their fields."""

from __future__ import annotations

import math
import re
from pathlib import Path

from ospc.errors import RecordingError, quoted
from ospc.formats.files import read_bytes
from ospc.formats.scanning import NUMBER

MAX_LINES = 1_000_000
"""Maximum number of lines of a text file: nine hours at 30 frames per second."""

MAX_LINE_CHARACTERS = 4096
"""Maximum length of a line in a text file; a frame takes about fifty characters."""

EXPOSURE = "the exposure"
"""How messages call the field with the exposure."""

_LINE_END = re.compile(r"\r\n|\n|\r")

_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
_CONTROL = re.compile(r"[\0-\x08\x0b\x0e-\x1f\x7f]")
"""Control characters that are in no text; a file with them is binary, or in an encoding of several bytes."""


def read_table_text(path: Path) -> str:
    """Read a text file in UTF-8, in UTF-16 with a byte order mark, or in Windows-1252, which includes Latin-1.

    Raises
    ------
    RecordingError
        If it cannot be read, is too large, or is not text in one of these encodings.
    """
    data = read_bytes(path, error=RecordingError)
    encodings = ("utf-16",) if data.startswith(_UTF16_MARKS) else ("utf-8-sig", "cp1252")
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        # Bytes of UTF-8 are hardly ever valid by chance, but almost any bytes are Windows-1252.
        if "\0" not in text and (encoding != "cp1252" or not _CONTROL.search(text)):
            return text
    raise RecordingError(
        f"{path}: not a text file in UTF-8, in UTF-16 with a byte order mark, or in Windows-1252; save it as UTF-8"
    )


def lines_of(text: str, source: str) -> list[tuple[int, str]]:
    """Return the non-blank lines with their numbers, from 1; RecordingError if a limit is exceeded."""
    if text.count("\n") + text.count("\r") > 2 * MAX_LINES:
        raise RecordingError(f"{source}: has more than the {MAX_LINES} lines allowed; check the file")
    lines = [(number, line.strip()) for number, line in enumerate(_LINE_END.split(text), start=1) if line.strip()]
    for number, line in lines:
        if len(line) > MAX_LINE_CHARACTERS:
            raise RecordingError(
                f"{source}, line {number}: longer than {MAX_LINE_CHARACTERS} characters; check the file"
            )
    return lines


_FRACTION = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)/(\d{1,9}(?:\.\d{1,9})?)", re.ASCII)


def is_number(text: str) -> bool:
    """Return whether a field is a number, including NaN and infinities."""
    return NUMBER.fullmatch(text) is not None


def is_fraction(text: str) -> bool:
    """Return whether a field is a fraction such as ``1/250``, as cameras show exposure times in seconds."""
    return _FRACTION.fullmatch(text) is not None


def parse_number(text: str, what: str, place: str) -> float:
    """Return the number in a field, which may be NaN or infinite.

    ``what`` and ``place`` name the field, and the file and line, in the message.

    Raises
    ------
    RecordingError
        If it is not a number.
    """
    if is_number(text):
        return float(text)
    unknown = ", or write nan if it is unknown" if what == EXPOSURE else ""
    if not text:
        raise RecordingError(f"{place}: {what} is missing; add it{unknown}")
    raise RecordingError(
        f"{place}: {what} must be a number, not {quoted(text)}; write it like 1234.5, without a unit or "
        f"commas{unknown}"
    )


def parse_exposure(text: str, place: str, *, seconds: bool) -> float:
    """Return the exposure in a field; it may be a fraction if exposures are in seconds. Errors as for numbers."""
    fraction = _FRACTION.fullmatch(text)
    if fraction is None:
        return parse_number(text, EXPOSURE, place)
    if not seconds:
        raise RecordingError(
            f"{place}: the exposure {quoted(text)} is a fraction, but fractions are read in seconds only; "
            f"write it as a decimal number, or add --exposure-unit s if all exposures are in seconds"
        )
    dividend, divisor = float(fraction[1]), float(fraction[2])
    return dividend / divisor if divisor else math.inf


def exposures_in(path: str | Path) -> list[float]:
    """Return the last number of each line of a file, such as times.txt; lines that begin with ``#`` are comments.

    Errors are those of :func:`read_table_text` and :func:`parse_number`.
    """
    lines = [(n, line) for n, line in lines_of(read_table_text(Path(path)), str(path)) if not line.startswith("#")]
    return [
        parse_number(re.split(r"[\s,;]+", line.rstrip(",;"))[-1], EXPOSURE, f"{path}, line {n}") for n, line in lines
    ]
