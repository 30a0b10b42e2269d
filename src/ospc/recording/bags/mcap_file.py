"""MCAP files of ROS 1 and ROS 2, parsed by the package mcap.

The package reads whole records of any length and decompresses without a limit, so this module frames and decompresses
the records itself. Files are read from front to back, one chunk at a time: memory does not grow with their length.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, BinaryIO

from ospc.errors import RecordingError, needs_extra
from ospc.recording.bags.container import MAX_CHUNK_BYTES, MAX_TOPICS, BagFile, Encoding, Message, Topic, expand

MCAP_START = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 8, 11, 15
"""Opcodes of the records that are used (MCAP specification, version 0)."""

_CLASSES = {
    _FOOTER: "Footer",
    _SCHEMA: "Schema",
    _CHANNEL: "Channel",
    _CHUNK: "Chunk",
    _CHUNK_INDEX: "ChunkIndex",
    _STATISTICS: "Statistics",
}
"""Classes of mcap that parse their content; that of messages is not copied."""

_DIRECTORY = (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS)
_END_BYTES = 1 + 8 + 8 + 8 + 4 + len(MCAP_START)
"""Size of the last record of a file, its footer, with the magic bytes after it."""

_ENCODINGS: dict[str, Encoding] = {"ros1": "ros1", "cdr": "cdr"}
_IDL = ("ros2idl", "omgidl")


@dataclass
class _Directory:
    """Schemas, channels and chunks; a file states them before their messages and again in its summary."""

    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    chunks: list[tuple[int, int]] = field(default_factory=list)
    """Where each chunk begins, and the time of its last message in nanoseconds."""
    counts: dict[int, int] | None = None

    def add(self, opcode: int, content: bytes) -> None:
        record = _parsed(opcode, content)
        if opcode == _SCHEMA:
            self.schemas[record.id] = record
        elif opcode == _CHANNEL:
            self.channels[record.id] = record
        elif opcode == _CHUNK_INDEX:
            self.chunks.append((record.chunk_start_offset, record.message_end_time))
        else:
            self.counts = record.channel_message_counts
        if len(self.schemas) + len(self.channels) > MAX_TOPICS:
            raise RecordingError(f"has more than the {MAX_TOPICS} topics allowed")

    def topics(self) -> Iterator[Topic]:
        """Yield the topics whose messages ROS can read."""
        from rosbags.typesys.msg import normalize_msgtype

        for number, channel in self.channels.items():
            schema = self.schemas.get(channel.schema_id)
            encoding = _ENCODINGS.get(channel.message_encoding)
            if schema is None or encoding is None:
                continue
            messages = None if self.counts is None else self.counts.get(number, 0)
            definition = schema.data.decode("utf-8", "replace")
            kind = normalize_msgtype(schema.name)
            yield Topic(channel.topic, kind, messages, encoding, definition, schema.encoding in _IDL)

    def channels_of(self, names: Collection[str]) -> dict[int, str]:
        return {number: channel.topic for number, channel in self.channels.items() if channel.topic in names}


class McapFile(BagFile):
    """A file of a bag in the MCAP format."""

    _ADVICE = "record it again, or save the intact part with 'mcap recover'"

    def _open(self, names: Collection[str]) -> BinaryIO:
        return self.path.open("rb")

    def _topics(self, reader: BinaryIO) -> Iterator[Topic]:
        self._directory = _read_directory(reader)
        yield from self._directory.topics()

    def _messages(self, reader: BinaryIO, names: Collection[str], start_ns: int | None) -> Iterator[Message]:
        start = start_ns or 0
        ahead = [place for place, end_ns in self._directory.chunks if end_ns >= start]
        reader.seek(min(ahead) if start_ns is not None and ahead else len(MCAP_START))
        yield from _messages(reader, self._directory, names, start)


def _parsed(opcode: int, content: bytes) -> Any:
    with needs_extra("reading bags in the MCAP format", "ros"):
        from mcap import records
        from mcap.data_stream import ReadDataStream
    return getattr(records, _CLASSES[opcode]).read(ReadDataStream(BytesIO(content)))


def _read_directory(file: BinaryIO) -> _Directory:
    """Read the summary at the end of a file, or, if it has none, the whole file."""
    size = os.fstat(file.fileno()).st_size
    file.seek(max(0, size - _END_BYTES))
    end = file.read()
    if not end.endswith(MCAP_START) or end[0] != _FOOTER:
        raise RecordingError("the bag ends early: its end is missing")
    start = _parsed(_FOOTER, end[9:]).summary_start
    directory = _Directory()
    if 0 < start < size:
        file.seek(start)
        for opcode, content in _records(file, _DIRECTORY):
            directory.add(opcode, content)
    if not directory.channels:
        file.seek(len(MCAP_START))
        for _ in _messages(file, directory, (), 0):
            pass
    return directory


def _messages(file: BinaryIO, directory: _Directory, names: Collection[str], start_ns: int) -> Iterator[Message]:
    wanted = directory.channels_of(names)
    for opcode, content in _records(file, (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK)):
        if opcode == _CHUNK:
            chunk = _parsed(_CHUNK, content)
            if chunk.message_end_time < start_ns:
                continue
            inner = BytesIO(expand(chunk.data, chunk.compression, chunk.uncompressed_size))
            found = _records(inner, (_SCHEMA, _CHANNEL, _MESSAGE))
        else:
            found = iter([(opcode, content)])
        for inner_opcode, inner_content in found:
            if inner_opcode != _MESSAGE:
                directory.add(inner_opcode, inner_content)
                wanted = directory.channels_of(names)
                continue
            channel, _, log_ns, _ = struct.unpack_from("<HIQQ", inner_content)
            if channel in wanted and log_ns >= start_ns:
                yield Message(wanted[channel], log_ns, inner_content[22:])


def _records(file: BinaryIO, opcodes: Collection[int]) -> Iterator[tuple[int, bytes]]:
    """Yield the opcodes and contents of some records until the data or the summary ends; skip the others."""
    begun = file.tell()
    size = file.seek(0, os.SEEK_END)
    file.seek(begun)
    chunk = isinstance(file, BytesIO)
    # A chunk simply ends; a file must end with a record that says so.
    while not chunk or file.tell() < size:
        opcode, length = struct.unpack("<BQ", _exactly(file, 9))
        if opcode in (_FOOTER, _DATA_END):
            return
        if file.tell() + length > size:
            raise RecordingError("the bag ends early")
        if opcode not in opcodes:
            file.seek(length, os.SEEK_CUR)
        elif length > MAX_CHUNK_BYTES:
            raise RecordingError(f"has a record of {length} bytes, more than the {MAX_CHUNK_BYTES} allowed")
        else:
            yield opcode, _exactly(file, length)


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) != size:
        raise RecordingError("the bag ends early")
    return data
