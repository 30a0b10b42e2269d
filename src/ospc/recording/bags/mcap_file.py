"""MCAP files, whichever ROS they come from.

Source: the MCAP format specification, version 0. The file is read from front to back, one chunk at a time, so that
memory does not depend on its length, and its index is not needed.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from ospc.errors import RecordingError
from ospc.recording.bags.container import MAX_CHUNK_BYTES, Message, Topic, as_ros2_type, refusing_damage
from ospc.recording.bags.expansion import expand
from ospc.recording.bags.wire import Encoding

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 11, 15
_FOOTER_BYTES = 1 + 8 + 8 + 8 + 4
_MAX_RECORD_BYTES = 16 * 2**20
_MAX_TOPICS = 20_000
_ENCODINGS: dict[str, Encoding] = {"ros1": "ros1", "cdr": "cdr"}
_ADVICE = "record it again, or save what is whole with 'mcap recover'"


class _Record(NamedTuple):
    kind: int
    size: int


class _Schema(NamedTuple):
    name: str
    language: str
    description: str


@dataclass
class _Directory:
    """Schemas and channels met so far; a file states them before their messages, and again at its end."""

    schemas: dict[int, _Schema] = field(default_factory=dict)
    topics: dict[int, Topic] = field(default_factory=dict)
    counts: dict[int, int] | None = None

    def learn(self, kind: int, content: bytes) -> None:
        fields = _Fields(content)
        if kind == _SCHEMA:
            number = fields.number("H")
            name, language = fields.text(), fields.text()
            self.schemas[number] = _Schema(name, language, fields.text())
        elif kind == _CHANNEL:
            number, schema = fields.number("H"), self.schemas.get(fields.number("H"))
            name = fields.text()
            encoding = _ENCODINGS.get(fields.text())
            if schema is None or encoding is None:
                return
            idl = schema.language in ("ros2idl", "omgidl")
            self.topics[number] = Topic(name, as_ros2_type(schema.name), None, encoding, schema.description, idl)
        elif kind == _STATISTICS:
            fields.skip(42)
            length = fields.number("I")
            self.counts = dict(struct.iter_unpack("<HQ", fields.take(length)))
        if len(self.schemas) + len(self.topics) > _MAX_TOPICS:
            raise RecordingError(f"has more than the {_MAX_TOPICS} topics allowed")


class McapFile:
    """A file of a bag in the format MCAP.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RecordingError
        If it is damaged or ends early.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._open() as file:
            directory = self._read_directory(file)
        # Channels may be stated in a chunk that is passed over.
        self._directory = directory
        counts = directory.counts
        topics = directory.topics.items()
        self.topics = tuple(
            topic if counts is None else replace(topic, messages=counts.get(n, 0)) for n, topic in topics
        )

    def messages(self, names: Collection[str], start_ns: int | None = None) -> Iterator[Message]:
        """Give the messages of some topics in the order they are in the file.

        Raises
        ------
        RecordingError
            If it is damaged.
        """
        with self._open() as file:
            yield from self._scan(file, self._directory, frozenset(names), start_ns)

    @contextmanager
    def _open(self) -> Iterator[BinaryIO]:
        with refusing_damage(self.path, _ADVICE), self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{self.path}: is no MCAP file")
            yield file

    def _read_directory(self, file: BinaryIO) -> _Directory:
        """Return what the end of the file says about it, or, where it says nothing, what reading all of it does."""
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - _FOOTER_BYTES - len(MAGIC)))
        end = file.read()
        if not end.endswith(MAGIC) or end[0] != _FOOTER:
            raise RecordingError("the bag ends early: its end is missing")
        (start,) = struct.unpack_from("<Q", end, 9)
        directory = _Directory()
        if 0 < start < size:
            file.seek(start)
            while (record := _next(file)).kind not in (_FOOTER, _DATA_END):
                if record.kind in (_SCHEMA, _CHANNEL, _STATISTICS):
                    directory.learn(record.kind, _content(file, record))
                else:
                    file.seek(record.size, os.SEEK_CUR)
        if not directory.topics:
            file.seek(len(MAGIC))
            for _ in self._scan(file, directory, frozenset(), None):
                pass
        return directory

    def _scan(
        self, file: BinaryIO, directory: _Directory, names: Collection[str], start_ns: int | None
    ) -> Iterator[Message]:
        while (record := _next(file)).kind not in (_FOOTER, _DATA_END):
            if record.kind == _CHUNK:
                chunk = _chunk(file, record, start_ns)
                if chunk is not None:
                    yield from self._of_chunk(chunk, directory, names, start_ns)
            else:
                message = _take(file, record, directory, names, start_ns)
                if message is not None:
                    yield message

    def _of_chunk(
        self, chunk: bytes, directory: _Directory, names: Collection[str], start_ns: int | None
    ) -> Iterator[Message]:
        inner = BytesIO(chunk)
        while inner.tell() < len(chunk):
            record = _next(inner)
            if record.kind == _CHUNK:
                raise RecordingError("a chunk holds another")
            message = _take(inner, record, directory, names, start_ns)
            if message is not None:
                yield message


def _take(
    file: BinaryIO, record: _Record, directory: _Directory, names: Collection[str], start_ns: int | None
) -> Message | None:
    """Read a record; return it if it is a message that is wanted."""
    if record.kind in (_SCHEMA, _CHANNEL):
        directory.learn(record.kind, _content(file, record))
        return None
    if record.kind != _MESSAGE:
        _content(file, record, keep=False)
        return None
    channel, _, log_ns, _ = struct.unpack("<HIQQ", _exactly(file, 22))
    topic = directory.topics.get(channel)
    rest = _Record(_MESSAGE, record.size - 22)
    wanted = topic is not None and topic.name in names and (start_ns is None or log_ns >= start_ns)
    data = _content(file, rest, keep=wanted, limit=MAX_CHUNK_BYTES)
    return Message(topic.name, log_ns, data) if topic is not None and wanted else None


def _chunk(file: BinaryIO, record: _Record, start_ns: int | None) -> bytes | None:
    """Return the expanded content of a chunk; None where all of it was recorded too early."""
    place = file.tell()
    _, end_ns, size, _, length = struct.unpack("<QQQII", _exactly(file, 32))
    if start_ns is not None and end_ns < start_ns:
        file.seek(place + record.size)
        return None
    compression = _exactly(file, min(length, 64)).decode("ascii", "replace")
    (stored,) = struct.unpack("<Q", _exactly(file, 8))
    if stored > record.size or file.tell() + stored > place + record.size:
        raise RecordingError("a chunk is longer than its record")
    content = _content(file, _Record(_CHUNK, stored), limit=MAX_CHUNK_BYTES)
    file.seek(place + record.size)
    return expand(content, compression, size)


def _next(file: BinaryIO) -> _Record:
    kind, size = struct.unpack("<BQ", _exactly(file, 9))
    return _Record(kind, size)


def _content(file: BinaryIO, record: _Record, *, keep: bool = True, limit: int = _MAX_RECORD_BYTES) -> bytes:
    """Return the content of a record, or go past it; the end of the file must not come before."""
    if record.size < 0:
        raise RecordingError("a message is too short")
    if not keep:
        if record.size:
            # The last byte must be there: going beyond the end of a file is no error.
            file.seek(record.size - 1, os.SEEK_CUR)
            _exactly(file, 1)
        return b""
    if record.size > limit:
        raise RecordingError(f"states {record.size} bytes for one record, more than the {limit} allowed")
    return _exactly(file, record.size)


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) != size:
        raise RecordingError("the bag ends early")
    return data


class _Fields:
    """The fields of a record one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    def number(self, kind: str) -> int:
        (value,) = struct.unpack("<" + kind, self.take(struct.calcsize("<" + kind)))
        return int(value)

    def text(self) -> str:
        return self.take(self.number("I")).decode("utf-8", "replace")

    def skip(self, size: int) -> None:
        self.take(size)

    def take(self, size: int) -> bytes:
        part = self._data[self._place : self._place + size]
        if len(part) != size:
            raise RecordingError("a record ends early")
        self._place += size
        return part
