"""Bag files: their common base class, and ROS 1 and SQLite files, which the package rosbags reads."""

from __future__ import annotations

import bz2
import os
import sys
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple
from urllib.parse import quote

from ospc.errors import OspcError, RecordingError, message_of, needs_extra, os_error_as, quoted

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

MAX_CHUNK_BYTES = 256 * 2**20
"""Maximum size of chunks and messages, before and after decompression."""

MAX_TOPICS = 20_000
"""Maximum number of topics; large robots have a few hundred."""

ROS1_START, SQLITE_START = b"#ROSBAG V", b"SQLite format 3\0"
_ZSTD_START = b"\x28\xb5\x2f\xfd"
"""Magic number of a Zstandard frame (RFC 8878)."""

_QUOTED_CHARACTERS = 120
"""Maximum length of a library message that an error quotes."""

Encoding = Literal["ros1", "cdr"]
"""Serialisation of messages: ROS 1, or the Common Data Representation of ROS 2."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag, with name and type as in ROS 2, such as ``/camera/image_raw`` and ``sensor_msgs/msg/Image``.

    ``messages`` is None if the bag does not state their number. ``definition`` is the definition of the type, empty
    if the bag does not include it, and ``idl`` is whether it is in IDL.
    """

    name: str
    type: str
    messages: int | None
    encoding: Encoding
    definition: str = ""
    idl: bool = False


class Message(NamedTuple):
    """A serialised message with the name of its topic and the time at which it was recorded."""

    topic: str
    log_ns: int
    data: bytes


class BagFile(ABC):
    """A file of a bag, and its topics.

    Raises
    ------
    RecordingError
        If the file is damaged or truncated.
    MissingExtraError
        If the optional dependency for bags is not installed.
    """

    _ADVICE: ClassVar[str]

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._reader(()) as reader:
            self.topics = tuple(self._topics(reader))

    def messages(self, names: Collection[str], start_ns: int | None = None) -> Iterator[Message]:
        """Yield the messages of the named topics, always in the same order.

        Messages recorded before ``start_ns`` are skipped. RecordingError if the file is damaged.
        """
        with self._reader(names) as reader:
            yield from self._messages(reader, names, start_ns)

    @abstractmethod
    def _open(self, names: Collection[str]) -> AbstractContextManager[Any]:
        """Open a reader that only needs messages of these topics."""

    @abstractmethod
    def _topics(self, reader: Any) -> Iterator[Topic]: ...

    @abstractmethod
    def _messages(self, reader: Any, names: Collection[str], start_ns: int | None) -> Iterator[Message]: ...

    @contextmanager
    def _reader(self, names: Collection[str]) -> Iterator[Any]:
        """Open a reader, and turn errors of the library into a RecordingError that names the file."""
        unread = os_error_as(RecordingError, f"{self.path}: cannot be read", "check the file and its permissions")
        with unread:
            try:
                with self._open(names) as reader:
                    yield reader
            except RecordingError as error:  # of inner functions, which do not know the file
                raise RecordingError(f"{self.path}: {error}; {self._ADVICE}") from None
            except (OspcError, OSError):
                raise
            except Exception as error:
                said = message_of(error, _QUOTED_CHARACTERS)
                why = f" ({said})" if said else ""
                raise RecordingError(f"{self.path}: the bag is damaged or truncated{why}; {self._ADVICE}") from None


def expand(data: bytes, compression: str, size: int | None = None) -> bytes:
    """Decompress ``zstd``, ``lz4``, ``bz2``, or ``none``, to exactly ``size`` bytes if given.

    Raises
    ------
    RecordingError
        If the result has another size or exceeds :data:`~ospc.recording.bags.container.MAX_CHUNK_BYTES`, or the
        compression is unknown.
    """
    limit = MAX_CHUNK_BYTES if size is None else size
    if limit > MAX_CHUNK_BYTES:
        raise RecordingError(f"a chunk expands to more than the {MAX_CHUNK_BYTES} bytes allowed")
    if compression in ("", "none"):
        expanded = data
    elif compression in ("zstd", "lz4", "bz2"):
        expanded = _decompressor(compression).decompress(data, max_length=limit + 1)
    else:
        raise RecordingError(f"its compression {quoted(compression)} is unknown")
    if len(expanded) > limit or (size is not None and len(expanded) != size):
        raise RecordingError("a chunk does not expand to its stated size")
    return bytes(expanded)


def _decompressor(compression: str) -> bz2.BZ2Decompressor:
    """Return an incremental decompressor with the interface of bz2."""
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    with needs_extra("reading compressed bags", "ros"):
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor as Decompressor
        elif sys.version_info >= (3, 14):
            from compression.zstd import ZstdDecompressor as Decompressor
        else:
            from backports.zstd import ZstdDecompressor as Decompressor
    decompressor: bz2.BZ2Decompressor = Decompressor()
    return decompressor


class RosbagsFile(BagFile):
    """A file read by the package rosbags; subclasses open it."""

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
    """A ROS 1 bag."""

    _ADVICE = "record it again, or recover the intact part with 'rosbag reindex'"
    _ENCODING = "ros1"

    @contextmanager
    def _open(self, names: Collection[str]) -> Iterator[Any]:
        with needs_extra("reading bags", "ros"):
            from rosbags.rosbag1.reader import IndexData, Reader, decompressors

        class SparingReader(Reader):
            """Only keeps the index of the requested topics: the index of an IMU can be larger than its messages."""

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
    """A ROS 2 bag file in SQLite."""

    _ADVICE = "record it again, or recover the intact part with 'sqlite3 FILE .recover'"
    _ENCODING = "cdr"

    @contextmanager
    def _open(self, names: Collection[str]) -> Iterator[Any]:
        with needs_extra("reading bags", "ros"):
            from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
        reader: Any = Sqlite3Reader(Path(quote(os.fsencode(self.path))))  # the package puts the path into a URI
        reader.open()
        try:
            # SQLite fills up the last page of a truncated file, and only notices that others are missing.
            (page_bytes,) = reader.dbconn.execute("PRAGMA page_size").fetchone()
            if self.path.stat().st_size % page_bytes:
                raise RecordingError("the bag is truncated")
            yield reader
        finally:
            reader.close()

    def _expanded(self, data: bytes) -> bytes:
        # Bags may compress messages individually; uncompressed ones never begin like this.
        return expand(data, "zstd") if data.startswith(_ZSTD_START) else data
