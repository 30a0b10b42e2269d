"""Text files with tables of frames: their lines, and the numbers in their fields."""

from __future__ import annotations

import re
from pathlib import Path

from ospc.errors import RecordingError, quoted
from ospc.formats.files import read_bytes
from ospc.formats.scanning import NUMBER

MAX_LINES = 1_000_000
"""Maximum number of lines of a text file: nine hours at 30 frames per second."""

MAX_LINE_CHARACTERS = 4096
"""Maximum length of a line in a text file; a frame takes about fifty characters."""

_LINE_END = re.compile(r"\r\n|\n|\r")


def read_table_text(path: Path) -> str:
    """Read a text file; RecordingError if it cannot be read, is too large, or is not text."""
    data = read_bytes(path, error=RecordingError)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: not a text file in UTF-8; save it as plain text") from None
    if "\0" in text:
        raise RecordingError(f"{path}: not a text file; save it as plain text in UTF-8")
    return text


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


def is_number(text: str) -> bool:
    """Return whether a field is a number, including NaN and infinities."""
    return NUMBER.fullmatch(text) is not None


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
    if not text:
        unknown = ", or write nan if it is unknown" if what == "the exposure" else ""
        raise RecordingError(f"{place}: {what} is missing; add it{unknown}")
    remedy = "use a decimal point" if "," in text else "correct the line"
    remedy = "write fractions as decimal numbers, in a column exposure_s" if "/" in text else remedy
    raise RecordingError(f"{place}: {what} must be a number, not {quoted(text)}; {remedy}")


def exposures_in(path: str | Path) -> list[float]:
    """Return the last number of each line of a file, such as times.txt; lines that begin with ``#`` are comments.

    Errors are those of :func:`read_table_text` and :func:`parse_number`.
    """
    lines = [(n, line) for n, line in lines_of(read_table_text(Path(path)), str(path)) if not line.startswith("#")]
    return [
        parse_number(re.split(r"[\s,;]+", line.rstrip(",;"))[-1], "the exposure", f"{path}, line {n}")
        for n, line in lines
    ]
