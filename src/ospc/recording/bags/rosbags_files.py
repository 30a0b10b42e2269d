"""Bags of ROS 1, and of ROS 2 in SQLite, read by the package rosbags."""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ospc.errors import MissingExtraError, RecordingError
from ospc.recording.bags.container import (
    MAX_CHUNK_BYTES,
    MAX_TOPICS,
    Encoding,
    Message,
    Topic,
    refusing_damage,
)
from ospc.recording.bags.expansion import ZSTD_START, expand

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

ROS1_START, SQLITE_START = b"#ROSBAG V", b"SQLite format 3\0"
_SQLITE_HEADER_BYTES = 100
_SQLITE_LARGEST_PAGE = 65536
"""Page size that a header states as 1, since it does not fit 16 bits."""


class Ros1File:
    """A bag of ROS 1.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RecordingError
        If it is damaged or was not closed.
    """

    _ADVICE = "record it again, or save the intact part with 'rosbag reindex'"

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._open(()) as reader:
            counts = [info.connection_counts for info in reader.chunk_infos]
            self.topics = tuple(
                _topic(connections[0], sum(count.get(c.id, 0) for count in counts for c in connections), "ros1")
                for connections in _by_name(reader.connections)
            )

    def messages(self, names: Collection[str], start_ns: int | None = None) -> Iterator[Message]:
        """Yield the messages of some topics in the order they were recorded.

        Raises
        ------
        RecordingError
            If it is damaged.
        """
        with self._open(names) as reader:
            wanted = [c for c in reader.connections if c.topic in names]
            if wanted:
                for connection, log_ns, data in reader.messages(wanted, start=start_ns):
                    yield Message(connection.topic, log_ns, _checked(bytes(data)))

    @contextmanager
    def _open(self, names: Collection[str]) -> Iterator[Any]:
        with refusing_damage(self.path, self._ADVICE):
            reader = _sparing_reader()(self.path, frozenset(names))
            with reader:
                # The decompressors of the package have no limit.
                reader.chunks = {
                    place: chunk._replace(decompressor=partial(expand, compression=_compression(chunk)))
                    for place, chunk in reader.chunks.items()
                }
                yield reader


def _sparing_reader() -> Any:
    """Return a reader that keeps the index of some topics only: that of an IMU can be larger than its messages."""
    try:
        from rosbags.rosbag1.reader import IndexData, Reader
    except ImportError:
        raise MissingExtraError("reading bags", "ros") from None

    class SparingReader(Reader):
        def __init__(self, path: Path, names: Collection[str]) -> None:
            super().__init__(path)
            self._names = names

        def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
            found: dict[int, list[IndexData]] = {}
            wanted = {c.id for c in self.connections if c.topic in self._names}

            class Found(dict[int, list[IndexData]]):
                def __missing__(self, key: int) -> list[IndexData]:
                    return found.setdefault(key, [])

            super().read_index_data(pos, Found())
            for key, entries in found.items():
                if key in wanted:
                    indexes[key].extend(entries)

    return SparingReader


def _compression(chunk: Any) -> str:
    from rosbags.rosbag1.reader import decompressors

    return next(name for name, function in decompressors.items() if function is chunk.decompressor)


class Sqlite3File:
    """A file of a bag of ROS 2 in SQLite.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RecordingError
        If it is damaged.
    """

    _ADVICE = "record it again, or save the intact part with 'sqlite3 FILE .recover'"

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._open() as reader:
            self.topics = tuple(
                _topic(connections[0], sum(c.msgcount for c in connections), "cdr")
                for connections in _by_name(reader.connections)
            )

    def messages(self, names: Collection[str], start_ns: int | None = None) -> Iterator[Message]:
        """Yield the messages of some topics in the order they were recorded.

        Raises
        ------
        RecordingError
            If it is damaged.
        """
        with self._open() as reader:
            wanted = [c for c in reader.connections if c.topic in names]
            if wanted:
                for connection, log_ns, data in reader.messages(wanted, start_ns):
                    yield Message(connection.topic, int(log_ns), _expanded(_checked(bytes(data))))

    @contextmanager
    def _open(self) -> Iterator[Any]:
        with refusing_damage(self.path, self._ADVICE):
            try:
                from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
            except ImportError:
                raise MissingExtraError("reading bags", "ros") from None
            _check_length(self.path)
            # The package puts the path into a URI without quoting it.
            if any(c in str(self.path) for c in "?#%"):
                raise RecordingError(f"{self.path}: its path must not contain '?', '#' or '%'; rename it")
            reader = Sqlite3Reader(self.path)
            reader.open()
            try:
                yield reader
            finally:
                reader.close()


def _check_length(path: Path) -> None:
    """Refuse a database shorter than its header says; SQLite itself notices only where it reads."""
    with path.open("rb") as file:
        header = file.read(_SQLITE_HEADER_BYTES)
        size = os.fstat(file.fileno()).st_size
    page_bytes, changes, pages = struct.unpack_from(">H6xII", header, 16)
    (valid_for,) = struct.unpack_from(">I", header, 92)
    page_bytes = _SQLITE_LARGEST_PAGE if page_bytes == 1 else page_bytes
    # If the two counters differ, the number of pages is not kept up to date (SQLite file format, section 1.3.7).
    if changes == valid_for and size < pages * page_bytes:
        raise RecordingError(f"{path}: the bag ends early; {Sqlite3File._ADVICE}")


def _expanded(data: bytes) -> bytes:
    """Return a message decompressed; bags may compress each by itself, and plain ones never begin like that."""
    return expand(data, "zstd") if data.startswith(ZSTD_START) else data


def _checked(data: bytes) -> bytes:
    if len(data) > MAX_CHUNK_BYTES:
        raise RecordingError(f"has a message larger than the {MAX_CHUNK_BYTES} bytes allowed")
    return data


def _by_name(connections: list[Connection]) -> list[list[Connection]]:
    if len(connections) > MAX_TOPICS:
        raise RecordingError(f"has more than the {MAX_TOPICS} topics allowed")
    found: dict[str, list[Connection]] = {}
    for connection in connections:
        found.setdefault(connection.topic, []).append(connection)
    return list(found.values())


def _topic(connection: Connection, messages: int, encoding: Encoding) -> Topic:
    from rosbags.interfaces import MessageDefinitionFormat

    if not (isinstance(connection.topic, str) and isinstance(connection.msgtype, str)):
        raise RecordingError("has a topic without a name or type")
    definition = connection.msgdef
    idl = definition.format == MessageDefinitionFormat.IDL
    return Topic(connection.topic, connection.msgtype, messages, encoding, definition.data, idl)
