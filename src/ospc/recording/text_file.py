"""Small text files of a recording, which are not trusted."""

from __future__ import annotations

import re
from pathlib import Path

from ospc.errors import RecordingError, quoted
from ospc.formats.files import read_bytes
from ospc.formats.scanning import NUMBER

MAX_LINES = 1_000_000
"""Text files with more lines are refused: that is nine hours at 30 frames per second."""

MAX_LINE_CHARACTERS = 4096
"""Text files with longer lines are refused; a frame takes about fifty characters."""

_LINE_END = re.compile(r"\r\n|\n|\r")


def read_text(path: Path) -> str:
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
    """Return the lines that are not blank, with their numbers as an editor counts them.

    RecordingError if there are too many lines or one is too long.
    """
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
    """Tell whether a field is a number, NaN and infinities included."""
    return NUMBER.fullmatch(text) is not None


def parse_number(text: str, what: str, place: str) -> float:
    """Return the number in a field; NaN and infinities count as numbers, for the caller to judge.

    RecordingError if it is not a number; the message names the place, file and line, and what the field holds.
    """
    if is_number(text):
        return float(text)
    raise RecordingError(f"{place}: {what} must be a number, not {quoted(text)}; correct the line")


def exposures_in(path: str | Path) -> list[float]:
    """Return the last number of each line of a file, such as times.txt; ``#`` begins a comment.

    Errors are those of :func:`read_text` and :func:`parse_number`.
    """
    lines = [(n, line) for n, line in lines_of(read_text(Path(path)), str(path)) if not line.startswith("#")]
    return [
        parse_number(re.split(r"[\s,;]+", line.rstrip(",;"))[-1], "the exposure", f"{path}, line {n}")
        for n, line in lines
    ]
