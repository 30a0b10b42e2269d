"""Bags of ROS 1, and of ROS 2 in SQLite, read by the package rosbags."""

from __future__ import annotations

import os
import struct
from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ospc.errors import RecordingError, needs_extra
from ospc.recording.bags.container import MAX_CHUNK_BYTES, MAX_TOPICS, BagFile, Encoding, Message, Topic, expand

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

ROS1_START, SQLITE_START = b"#ROSBAG V", b"SQLite format 3\0"
_ZSTD_START = b"\x28\xb5\x2f\xfd"
"""Magic number of a Zstandard frame (RFC 8878)."""

_SQLITE_HEADER_BYTES = 100
_SQLITE_LARGEST_PAGE = 65536
"""Page size that a header states as 1, since it does not fit 16 bits."""


class RosbagsFile(BagFile):
    """A file that a reader of rosbags reads; the formats differ in how it is opened."""

    _ENCODING: ClassVar[Encoding]

    def _topics(self, reader: Any) -> Iterator[Topic]:
        from rosbags.interfaces import MessageDefinitionFormat

        if len(reader.connections) > MAX_TOPICS:
            raise RecordingError(f"has more than the {MAX_TOPICS} topics allowed")
        by_name: dict[str, list[Connection]] = {}
        for connection in reader.connections:
            if not (isinstance(connection.topic, str) and isinstance(connection.msgtype, str)):
                raise RecordingError("has a topic without a name or type")
            by_name.setdefault(connection.topic, []).append(connection)
        for name, connections in by_name.items():
            messages = sum(self._count(reader, connection) for connection in connections)
            definition = connections[0].msgdef
            idl = definition.format == MessageDefinitionFormat.IDL
            yield Topic(name, connections[0].msgtype, messages, self._ENCODING, definition.data, idl)

    def _count(self, reader: Any, connection: Connection) -> int:
        return connection.msgcount

    def _messages(self, reader: Any, names: Collection[str], start_ns: int | None) -> Iterator[Message]:
        wanted = [connection for connection in reader.connections if connection.topic in names]
        # Without connections, the readers would yield the messages of all topics.
        found = reader.messages(wanted, start_ns) if wanted else ()
        for connection, log_ns, data in found:
            if len(data) > MAX_CHUNK_BYTES:
                raise RecordingError(f"has a message larger than the {MAX_CHUNK_BYTES} bytes allowed")
            yield Message(connection.topic, int(log_ns), self._expanded(bytes(data)))

    def _expanded(self, data: bytes) -> bytes:
        return data


class Ros1File(RosbagsFile):
    """A bag of ROS 1."""

    _ADVICE = "record it again, or save the intact part with 'rosbag reindex'"
    _ENCODING = "ros1"

    @contextmanager
    def _open(self, names: Collection[str]) -> Iterator[Any]:
        with needs_extra("reading bags", "ros"):
            from rosbags.rosbag1.reader import IndexData, Reader, decompressors

        class SparingReader(Reader):
            """Keeps the index of some topics only: that of an IMU can be larger than its messages."""

            def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
                found: defaultdict[int, list[IndexData]] = defaultdict(list)
                super().read_index_data(pos, found)
                wanted = {connection.id for connection in self.connections if connection.topic in names}
                for key in wanted & found.keys():
                    indexes[key].extend(found[key])

        # The decompressors of the package have no limit.
        limited = {function: partial(expand, compression=name) for name, function in decompressors.items()}
        with SparingReader(self.path) as reader:
            reader.chunks = {
                place: chunk._replace(decompressor=limited[chunk.decompressor])
                for place, chunk in reader.chunks.items()
            }
            yield reader

    def _count(self, reader: Any, connection: Connection) -> int:
        return sum(info.connection_counts.get(connection.id, 0) for info in reader.chunk_infos)


class Sqlite3File(RosbagsFile):
    """A file of a bag of ROS 2 in SQLite."""

    _ADVICE = "record it again, or save the intact part with 'sqlite3 FILE .recover'"
    _ENCODING = "cdr"

    @contextmanager
    def _open(self, names: Collection[str]) -> Iterator[Any]:
        with needs_extra("reading bags", "ros"):
            from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
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

    def _expanded(self, data: bytes) -> bytes:
        # Bags may compress each message by itself; plain ones never begin like that.
        return expand(data, "zstd") if data.startswith(_ZSTD_START) else data


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
        raise RecordingError("the bag ends early")
