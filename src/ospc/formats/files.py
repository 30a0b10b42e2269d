"""Safe reading of files, with limits on their size, and atomic writing."""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ospc.errors import FormatError, OspcError, escaped, os_error_as
from ospc.system.atomic import write_atomically

LARGEST_TEXT = 64 * 2**20
"""Maximum size of a text file in bytes. A table of 65536 values has half a megabyte, a list of 10⁶ frames 50."""

LARGEST_FILE = 2**30
"""Maximum size of other files in bytes: an uncompressed 16-bit image with the most pixels has a quarter of this."""

_PIECE_BYTES = 2**20
"""Number of bytes read at a time from a file that does not state its size."""

_SIGNATURE_BYTES = 16
"""Number of bytes that contain the signatures of all formats."""

BYTE_ORDER_MARK = "\ufeff"
"""Written by some editors at the beginning of UTF-8 text, and not skipped by C programs."""

_BEGINS_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters of cells that spreadsheets treat as formulas."""


def by_name(name: str) -> tuple[tuple[object, ...], str]:
    """Return a sorting key in which 2 comes before 10, with and without leading zeros."""
    parts: list[object] = list(re.split(r"(\d+)", name))
    for i in range(1, len(parts), 2):
        # Compared by length and then as text, because names may have more digits than Python converts.
        digits = str(parts[i]).lstrip("0")
        parts[i] = (len(digits), digits)
    return tuple(parts), name


def read_bytes(path: str | Path, limit: int = LARGEST_TEXT, error: type[OspcError] = FormatError) -> bytes:
    """Return the content of a file; raise ``error`` if it does not exist, cannot be read, or exceeds the limit."""
    place = escaped(str(path))
    unread = os_error_as(error, f"{place}: cannot be read", "check the path and its permissions")
    with unread, Path(path).open("rb") as stream:
        # read(limit) would allocate that much memory.
        content = stream.read(min(os.fstat(stream.fileno()).st_size, limit) + 1)
        # A pipe states a size of 0.
        while len(content) <= limit and (more := stream.read(min(_PIECE_BYTES, limit + 1 - len(content)))):
            content += more
    if len(content) > limit:
        raise error(f"{place}: larger than the {limit} bytes allowed; check the file")
    return content


def beginning(path: Path, count: int = _SIGNATURE_BYTES) -> bytes:
    """Return the first bytes of a file, by which its format is recognised; empty if the path is no file.

    OSError if it cannot be read.
    """
    if not path.is_file():
        return b""
    with path.open("rb") as stream:
        return stream.read(count)


def read_text(path: str | Path, limit: int = LARGEST_TEXT, *, keep_mark: bool = False) -> str:
    """Return the content of a text file with the errors of :func:`read_bytes`; invalid UTF-8 is replaced.

    A byte order mark at the beginning is removed unless ``keep_mark``.
    """
    text = read_bytes(path, limit).decode("utf-8", errors="replace")
    return text if keep_mark else text.removeprefix(BYTE_ORDER_MARK)


def json_object(path: str | Path) -> dict[str, Any]:
    """Return the object in a JSON file; an empty one if it cannot be read or is no regular file."""
    try:
        # Reading a pipe in a folder from outside would never end.
        content = json.loads(read_text(path)) if Path(path).is_file() else {}
    except (OSError, FormatError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def schema_of(path: str | Path) -> str:
    """Return the name of the schema of a JSON file, without its version; empty if there is none."""
    return str(json_object(path).get("schema", "")).partition("/")[0]


def json_text(content: Any, indent: int | None = 1) -> str:
    """Return JSON-compatible values as text, with null for numbers that are not finite, which JSON does not have."""
    finite = json.loads(json.dumps(content), parse_constant=lambda _name: None)
    return json.dumps(finite, indent=indent, allow_nan=False)


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a file atomically and return its path; FormatError if that fails."""
    with os_error_as(FormatError, f"{path}: cannot be written", "check that the folder exists and is writable"):
        return write_atomically(path, content)


def write_text(path: str | Path, content: str) -> Path:
    """Write a UTF-8 text file atomically with unchanged line ends, and return its path; FormatError if that fails.

    Characters that UTF-8 cannot encode, from file names that are not UTF-8, are escaped.
    """
    return write_bytes(path, content.encode("utf-8", "backslashreplace"))


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Return rows of numbers and texts as CSV without formulas; None becomes an empty cell.

    Texts that a spreadsheet would execute as a formula get an apostrophe in front.
    """
    text = io.StringIO()
    # Text is always quoted, because the csv module does not quote carriage returns, which end a row.
    writer = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC)
    for row in rows:
        writer.writerow(
            [f"'{cell}" if isinstance(cell, str) and cell.startswith(_BEGINS_FORMULA) else cell for cell in row]
        )
    return text.getvalue()
