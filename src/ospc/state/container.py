"""One file of named arrays and a JSON header, checksummed: never torn, never misread, nothing in it is executed.

Two lines of text, then the body::

    ospc-state 1
    <SHA-256 of the body, 64 hexadecimal digits> <length of the body in bytes>

The body is one line of JSON, ``{"kind": …, "version": …, "content": …, "arrays": […]}``, ended by a line feed, and
after it the arrays in the order of their list, each deflated (RFC 1950). An entry of the list has the array's
``name``, ``dtype``, ``shape``, the ``stored`` dtype, narrower where that loses nothing, and the ``bytes`` it takes.
Before deflation the bytes of all values are grouped by significance: first the lowest of every value, then the next.
All numbers are little-endian.
"""

from __future__ import annotations

import json
import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ospc.atomic import write_atomically
from ospc.errors import FormatError

Array = npt.NDArray[Any]

_MAGIC = b"ospc-state 1\n"
_ANY_VERSION = b"ospc-state "
_MAX_FILE_BYTES = 256 * 2**20
_MAX_ARRAY_BYTES = 2**30
_DTYPES = ("<f8", "<f4", "<i8", "<i4", "<i2", "|i1", "|u1", "<u2", "|b1")
_NARROWER = {"<f8": ("<f4",), "<i8": ("|i1", "<i2", "<i4")}
_FAST = 1
_BEGINNING = 300
_KIND = re.compile(rb'ospc-state 1\n[^\n]*\n\{"kind":"(?P<kind>[a-z-]{1,40})"')


@dataclass(frozen=True)
class Container:
    """What a file holds.

    Attributes
    ----------
    kind
        What the content means.
    version
        Version of that meaning.
    content
        JSON-compatible values.
    arrays
        Arrays by name.
    """

    kind: str
    version: int
    content: dict[str, Any]
    arrays: Mapping[str, Array] = field(default_factory=dict)


def to_bytes(container: Container) -> bytes:
    """Return the file of a container; equal containers give equal bytes."""
    entries, blobs = [], []
    for name, array in container.arrays.items():
        entry, blob = _packed(name, array)
        entries.append(entry)
        blobs.append(blob)
    header = {
        "kind": container.kind,
        "version": container.version,
        "content": container.content,
        "arrays": entries,
    }
    line = json.dumps(header, separators=(",", ":"), allow_nan=False, ensure_ascii=False).encode() + b"\n"
    body = b"".join([line, *blobs])
    return _MAGIC + f"{sha256(body).hexdigest()} {len(body)}\n".encode() + body


def save(container: Container, path: str | Path) -> Path:
    """Write a container, whole or not at all, and return its path.

    Raises
    ------
    FormatError
        If it cannot be written; an earlier file is unchanged then.
    """
    place = Path(path)
    try:
        return write_atomically(place, to_bytes(container))
    except OSError as error:
        raise FormatError(
            f"{place}: cannot be written ({error.strerror}); check that the folder exists and allows it"
        ) from None


def load(path: str | Path, kind: str, version: int) -> Container:
    """Read a container of one kind.

    Parameters
    ----------
    path
        The file.
    kind, version
        What it must hold.

    Raises
    ------
    FormatError
        If there is no such file, or it is none of these, torn, damaged, or of another kind or version.
    """
    place = Path(path)
    try:
        if place.stat().st_size > _MAX_FILE_BYTES:
            raise FormatError(f"{place}: no state is larger than {_MAX_FILE_BYTES // 2**20} MB; give another file")
        data = place.read_bytes()
    except FileNotFoundError:
        raise FormatError(f"{place}: there is no such state; check the path") from None
    except OSError as error:
        raise FormatError(f"{place}: cannot be read ({error.strerror}); check the path and its rights") from None
    found = from_bytes(data, str(place))
    if found.kind != kind:
        raise FormatError(f"{place}: holds a {found.kind} state, but a {kind} state is needed here")
    if found.version != version:
        age = "an older" if found.version < version else "a newer"
        raise FormatError(
            f"{place}: was written by {age} version of this program (state version {found.version}, expected "
            f"{version}); make it anew from the recording"
        )
    return found


def from_bytes(data: bytes, name: str) -> Container:
    """Return what the bytes of a file hold.

    Parameters
    ----------
    data
        All of the file.
    name
        What to call it in messages.

    Raises
    ------
    FormatError
        If they are no container, or a torn or damaged one.
    """
    body = _checked_body(data, name)
    try:
        line, _, rest = body.partition(b"\n")
        header = json.loads(line)
        arrays = _unpacked_all(header["arrays"], rest)
        content, kind, version = header["content"], header["kind"], header["version"]
        if not (isinstance(content, dict) and isinstance(kind, str) and type(version) is int):
            raise ValueError("its header has values of the wrong type")
    except (LookupError, TypeError, ValueError, RecursionError, MemoryError, zlib.error) as error:
        raise FormatError(f"{name}: not readable as a state ({type(error).__name__}: {error})") from None
    return Container(kind, version, content, arrays)


def kind_of(path: str | Path) -> str:
    """Return what kind a file says it is of; empty where it does not say so. Only :func:`load` checks the rest."""
    try:
        with Path(path).open("rb") as stream:
            beginning = stream.read(_BEGINNING)
    except OSError:
        return ""
    found = _KIND.match(beginning)
    return found["kind"].decode("ascii") if found else ""


def _checked_body(data: bytes, name: str) -> bytes:
    if not data.startswith(_ANY_VERSION):
        raise FormatError(f"{name}: is not a state file of this program; give one that 'ospc calibrate' wrote")
    if not data.startswith(_MAGIC):
        first = data[:40].split(b"\n", 1)[0].decode("ascii", "replace")
        raise FormatError(f"{name}: a container of another version ({first!r}); make it anew from the recording")
    line, _, body = data[len(_MAGIC) :].partition(b"\n")
    digest, _, length = line.decode("ascii", "replace").partition(" ")
    if length != str(len(body)) or digest != sha256(body).hexdigest():
        raise FormatError(f"{name}: torn or damaged, its checksum is wrong; make it anew from the recording")
    return body


def _packed(name: str, array: Array) -> tuple[dict[str, Any], bytes]:
    plain = np.ascontiguousarray(array)
    dtype = plain.dtype.newbyteorder("<").str if plain.dtype.itemsize > 1 else plain.dtype.str
    if dtype not in _DTYPES:
        raise TypeError(f"array {name} of type {plain.dtype} cannot be stored")
    stored = next((narrow for narrow in _NARROWER.get(dtype, ()) if _holds(plain, narrow)), dtype)
    grouped = plain.astype(stored).reshape(-1, 1).view(np.uint8).T.tobytes()
    blob = zlib.compress(grouped, _FAST)
    entry = {"name": name, "dtype": dtype, "shape": list(np.shape(array)), "stored": stored, "bytes": len(blob)}
    return entry, blob


def _holds(array: Array, narrow: str) -> bool:
    """Tell whether a narrower type holds every value exactly, signs of zeros included."""
    if array.dtype.kind == "i":
        limits = np.iinfo(narrow)
        return array.size == 0 or bool(array.min() >= limits.min and array.max() <= limits.max)
    with np.errstate(over="ignore", invalid="ignore"):
        there = array.astype(narrow)
    return there.astype(array.dtype).tobytes() == array.tobytes()


def _unpacked_all(entries: list[dict[str, Any]], blobs: bytes) -> dict[str, Array]:
    ends = np.cumsum([0, *(int(entry["bytes"]) for entry in entries)]).tolist()
    if any(begin > end for begin, end in pairwise(ends)) or ends[-1] != len(blobs):
        raise ValueError("the lengths of its arrays do not add up")
    if sum(_size(entry) for entry in entries) > _MAX_ARRAY_BYTES:
        raise ValueError("its arrays are too large")
    return {
        entry["name"]: _unpacked(entry, blobs[begin:end])
        for entry, (begin, end) in zip(entries, pairwise(ends), strict=True)
    }


def _size(entry: dict[str, Any]) -> int:
    shape = entry["shape"]
    if entry["dtype"] not in _DTYPES or entry["stored"] not in (entry["dtype"], *_NARROWER.get(entry["dtype"], ())):
        raise ValueError(f"array {entry['name']!r} is of an unknown type")
    if len(shape) > 8 or not all(type(side) is int and side >= 0 for side in shape):
        raise ValueError(f"array {entry['name']!r} has an impossible shape")
    return int(math.prod(shape)) * int(np.dtype(entry["dtype"]).itemsize)


def _unpacked(entry: dict[str, Any], blob: bytes) -> Array:
    stored = np.dtype(entry["stored"])
    expected = math.prod(entry["shape"]) * stored.itemsize
    inflater = zlib.decompressobj()
    # One byte more than expected is enough to see that there are too many; the rest is never unpacked.
    grouped = inflater.decompress(blob, expected + 1)
    if len(grouped) != expected or not inflater.eof or inflater.unused_data:
        raise ValueError(f"array {entry['name']!r} has not as many values as it should")
    values: Array = np.frombuffer(grouped, np.uint8).reshape(stored.itemsize, -1).T.copy().view(stored)
    return values.astype(entry["dtype"]).reshape(entry["shape"])
