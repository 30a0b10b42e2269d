"""Reads and writes whole files safely: bounded when reading, all or nothing when writing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ospc.atomic import write_atomically
from ospc.errors import FormatError

LARGEST_TEXT = 64 * 2**20
"""Bytes; larger parameter files are refused. The largest real one, a table of 65536 values, has half a megabyte."""


def read_bytes(path: str | Path, limit: int = LARGEST_TEXT) -> bytes:
    """Return the content of a file no larger than ``limit`` bytes.

    Raises
    ------
    FormatError
        If there is no such file, it cannot be read, or it is larger.
    """
    place = Path(path)
    try:
        with place.open("rb") as stream:
            content = stream.read(limit + 1)
    except FileNotFoundError:
        raise FormatError(f"{place}: there is no such file; check the path") from None
    except OSError as error:
        raise FormatError(f"{place}: cannot be read ({error.strerror}); check the path and its permissions") from None
    if len(content) > limit:
        raise FormatError(f"{place}: larger than {limit} bytes, which no file of its kind is; check the path")
    return content


def read_text(path: str | Path, limit: int = LARGEST_TEXT) -> str:
    """Return the content of a text file; bytes that are not UTF-8 become replacement characters.

    Raises
    ------
    FormatError
        As :func:`read_bytes`.
    """
    return read_bytes(path, limit).decode("utf-8", errors="replace")


def json_object(path: str | Path) -> dict[str, Any]:
    """Return the object in a JSON file; an empty one where none can be read."""
    try:
        content = json.loads(read_text(path))
    except (FormatError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a file atomically and return its path: readers see the old content or the new one, never a part.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    try:
        return write_atomically(path, content)
    except OSError as error:
        raise FormatError(
            f"{path}: cannot be written ({error.strerror}); check that the folder exists and is writable"
        ) from None


def write_text(path: str | Path, content: str) -> Path:
    """Write a UTF-8 text file atomically, line ends as given, and return its path.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    return write_bytes(path, content.encode("utf-8"))
