"""State files: a NumPy ``.npz`` archive with JSON, named arrays and a checksum.

The first entry of the archive is ``<kind>.json`` with ``{"version": …, "content": …}``; the others are arrays,
``<name>.npy``. All are deflated and have the same date, so that equal content gives equal bytes. The comment of the
archive is the SHA-256 of everything before it, as 64 hexadecimal digits. ``numpy.load`` can read the arrays.
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np
import numpy.typing as npt

from ospc.errors import UNREADABLE, FormatError, os_error_as, path_of
from ospc.system.atomic import write_atomically

Array = npt.NDArray[Any]

STATE_NAME = "state.ospc"
"""Name of the state in an output folder."""
_MAX_FILE_BYTES = 256 * 2**20
_MAX_UNPACKED_BYTES = 2**30
"""Far more than any state needs, and small enough to unpack in memory."""
_DTYPES = ("<f8", "<f4", "<i8", "<i4", "<i2", "|i1", "|u1", "<u2", "|b1")
"""Types of arrays allowed in files."""
_COMPRESSION = 1
"""The fastest level of zlib: higher ones hardly compress noisy numbers better, and checkpoints must be fast."""
_CHECKSUM_BYTES = 64
_BEGINNING = re.compile(rb"PK\x03\x04.{26}(?P<kind>[a-z-]{1,40})\.json", re.DOTALL)
"""First local header of a zip archive, 30 bytes, and the name of the entry, which follows it."""
_BEGINNING_BYTES = 30 + 40 + len(".json")
"""Its largest length in bytes: the header, the longest kind, and the suffix."""

_ARRAY_NAME = re.compile(r"[\w.-]{1,200}", re.ASCII)


@dataclass(frozen=True)
class Container:
    """The content of a state file: JSON-compatible values, and arrays by name.

    ``kind`` names the type of state, in lower-case letters and hyphens, and ``version`` is the version of its layout.
    """

    kind: str
    version: int
    content: dict[str, Any]
    arrays: Mapping[str, Array] = field(default_factory=dict)


def to_bytes(container: Container) -> bytes:
    """Return the bytes of the file; equal containers give equal bytes."""
    head = {"version": container.version, "content": container.content}
    packed = io.BytesIO()
    with ZipFile(packed, "w", ZIP_DEFLATED, compresslevel=_COMPRESSION) as archive:
        # Entries opened by name get the date 1980-01-01 instead of today's.
        with archive.open(f"{container.kind}.json", "w") as entry:
            text = json.dumps(head, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
            # A lone surrogate, from a file name that is not UTF-8, becomes its JSON escape.
            entry.write(text.encode("utf-8", "backslashreplace"))
        for name, array in container.arrays.items():
            with archive.open(f"{name}.npy", "w") as entry:
                np.lib.format.write_array(entry, _storable(name, array), version=(1, 0), allow_pickle=False)
        archive.comment = bytes(_CHECKSUM_BYTES)
    with packed.getbuffer() as whole:
        whole[-_CHECKSUM_BYTES:] = sha256(whole[:-_CHECKSUM_BYTES]).hexdigest().encode()
    return packed.getvalue()


def save(container: Container, path: str | Path) -> Path:
    """Write a container atomically and return its path; FormatError if that fails."""
    place = path_of(path, FormatError, "a state")
    with os_error_as(FormatError, f"{place}: cannot be written", "check that the folder exists and is writable"):
        return write_atomically(place, to_bytes(container))


def load(path: str | Path, kind: str, version: int) -> Container:
    """Read a container.

    Raises
    ------
    FormatError
        If the file does not exist, is not a container, is truncated or damaged, or has another kind or version.
    """
    place = path_of(path, FormatError, "a state")
    with os_error_as(FormatError, f"{place}: cannot be read", "check the path and its permissions"):
        if not place.is_file():  # reading a pipe in a folder from outside would never end
            raise FormatError(
                f"{place}: there is no such state; give the folder of 'ospc calibrate' or its state.ospc"
            )
        with place.open("rb") as stream:
            data = stream.read(_MAX_FILE_BYTES + 1)
    if len(data) > _MAX_FILE_BYTES:
        raise FormatError(f"{place}: no state is larger than {_MAX_FILE_BYTES // 2**20} MB; give another file")
    found = from_bytes(data, str(place))
    if found.kind != kind:
        raise FormatError(f"{place}: contains a {found.kind} state, but a {kind} state is needed")
    if found.version != version:
        age = "an older" if found.version < version else "a newer"
        raise FormatError(
            f"{place}: was written by {age} version of this program (state version {found.version}, expected "
            f"{version}); create it again from the recording"
        )
    return found


def from_bytes(data: bytes, name: str) -> Container:
    """Return the container in the bytes of a file; FormatError with ``name`` if it is not a complete container."""
    kind = _kind(data)
    if not kind:
        raise FormatError(f"{name}: is not a state file of this program; give the state.ospc of 'ospc calibrate'")
    if sha256(data[:-_CHECKSUM_BYTES]).hexdigest().encode() != data[-_CHECKSUM_BYTES:]:
        raise FormatError(f"{name}: truncated or damaged (its checksum is wrong); create it again from the recording")
    try:
        with ZipFile(io.BytesIO(data)) as archive:
            first, *others = archive.infolist()
            if sum(entry.file_size for entry in archive.infolist()) > _MAX_UNPACKED_BYTES:
                raise ValueError("its content is too large")
            head = json.loads(_unpacked(archive, first))
            arrays = {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in others}
        content, version = head["content"], head["version"]
        if not (isinstance(content, dict) and type(version) is int):
            raise ValueError("values are of the wrong type")
    except UNREADABLE as error:
        raise FormatError(f"{name}: not readable as a state ({type(error).__name__}: {error})") from None
    return Container(kind, version, content, arrays)


def state_in(path: str | Path) -> Path:
    """Return the path of a state, given as the file or as its output folder."""
    place = path_of(path, FormatError, "a state")
    return place / STATE_NAME if place.is_dir() else place


def kind_of(path: str | Path) -> str:
    """Return the kind in the header of a file, or "" if there is none; only :func:`load` checks the rest."""
    place = Path(path)
    try:
        if not place.is_file():
            return ""
        with place.open("rb") as stream:
            return _kind(stream.read(_BEGINNING_BYTES))
    except OSError:
        return ""


def _kind(data: bytes) -> str:
    found = _BEGINNING.match(data)
    return found["kind"].decode("ascii") if found else ""


def _storable(name: str, array: Array) -> Array:
    plain = np.asarray(array, array.dtype.newbyteorder("<"), order="C")
    if plain.dtype.str not in _DTYPES or not _ARRAY_NAME.fullmatch(name):
        raise TypeError(f"array {name!r} of type {array.dtype} cannot be stored")
    return plain


def _unpacked(archive: ZipFile, entry: ZipInfo) -> bytes:
    """Return the bytes of an entry, never more than its declared size."""
    # Other compression methods would unpack everything before the size can be checked.
    if entry.compress_type != ZIP_DEFLATED:
        raise ValueError(f"{entry.filename!r} is not deflated")
    with archive.open(entry) as stream:
        data = stream.read(entry.file_size)
    if len(data) != entry.file_size:
        raise ValueError(f"{entry.filename!r} is shorter than it should be")
    return data


def _array(archive: ZipFile, entry: ZipInfo) -> Array:
    data = _unpacked(archive, entry)
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{entry.filename!r} is an array of an unknown version")
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.str not in _DTYPES or by_columns:
        raise ValueError(f"{entry.filename!r} is an array of an unknown type")
    # Checked before numpy allocates the size given in the header.
    if math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise ValueError(f"{entry.filename!r} has a wrong number of values")
    return np.ndarray(shape, dtype, data, stream.tell()).copy()
