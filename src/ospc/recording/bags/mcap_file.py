"""MCAP files of ROS 1 and ROS 2, parsed by the package mcap.

The package reads records of any length and decompresses without a limit, so this module splits and decompresses the
records itself. Files are read from front to back, one chunk at a time, so memory does not grow with their length.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from ospc.errors import RecordingError, needs_extra
from ospc.recording.bags.container import MAX_CHUNK_BYTES, MAX_TOPICS, BagFile, Message, Topic, expand

MCAP_START = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 8, 11, 15
"""Opcodes of the records used here (MCAP specification, version 0)."""

_CLASSES = {
    _FOOTER: "Footer",
    _SCHEMA: "Schema",
    _CHANNEL: "Channel",
    _CHUNK: "Chunk",
    _CHUNK_INDEX: "ChunkIndex",
    _STATISTICS: "Statistics",
}
"""Classes of mcap that parse these records; messages are not parsed, to avoid a copy."""

_END_BYTES = 1 + 8 + 8 + 8 + 4 + len(MCAP_START)
"""Size of the last record of a file, the footer, and the magic bytes after it."""


class McapFile(BagFile):
    """A bag file in the MCAP format.

    Schemas, channels and chunks precede the messages, and are repeated in the summary at the end.
    """

    _ADVICE = "record it again, or recover the intact part with 'mcap recover'"

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._chunks: list[tuple[int, int]] = []  # offset of each, and time of its last message in nanoseconds
        self._counts: dict[int, int] | None = None
        super().__init__(path)

    def _open(self, names: Collection[str]) -> BinaryIO:
        return self.path.open("rb")

    def _topics(self, reader: BinaryIO) -> Iterator[Topic]:
        """Yield the topics with ROS messages."""
        from rosbags.typesys.msg import normalize_msgtype

        self._read_summary(reader)
        if not self._channels:
            for _ in self._messages(reader, (), None):
                pass  # without a summary, the whole file is read
        for number, channel in self._channels.items():
            schema = self._schemas.get(channel.schema_id)
            if schema is None or channel.message_encoding not in ("ros1", "cdr"):
                continue
            messages = None if self._counts is None else self._counts.get(number, 0)
            definition = schema.data.decode("utf-8", "replace")
            kind = normalize_msgtype(schema.name)
            idl = schema.encoding in ("ros2idl", "omgidl")
            yield Topic(channel.topic, kind, messages, channel.message_encoding, definition, idl)

    def _read_summary(self, file: BinaryIO) -> None:
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - _END_BYTES))
        end = file.read()
        if not end.endswith(MCAP_START) or end[0] != _FOOTER:
            raise RecordingError("the bag is truncated: its end is missing")
        start = _parsed(_FOOTER, end[9:]).summary_start
        if 0 < start < size:
            file.seek(start)
            for opcode, content in _records(file, (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS)):
                self._note(opcode, content)

    def _note(self, opcode: int, content: bytes) -> None:
        record = _parsed(opcode, content)
        if opcode == _SCHEMA:
            self._schemas[record.id] = record
        elif opcode == _CHANNEL:
            self._channels[record.id] = record
        elif opcode == _CHUNK_INDEX:
            self._chunks.append((record.chunk_start_offset, record.message_end_time))
        else:
            self._counts = record.channel_message_counts
        if len(self._schemas) + len(self._channels) > MAX_TOPICS:
            raise RecordingError(f"has more than the {MAX_TOPICS} topics allowed")

    def _messages(self, reader: BinaryIO, names: Collection[str], start_ns: int | None) -> Iterator[Message]:
        start = start_ns or 0
        ahead = [place for place, end_ns in self._chunks if end_ns >= start]
        reader.seek(min(ahead) if start_ns is not None and ahead else len(MCAP_START))
        for opcode, content in _unpacked(reader, start):
            if opcode != _MESSAGE:
                self._note(opcode, content)
                continue
            number, _, log_ns, _ = struct.unpack_from("<HIQQ", content)
            channel = self._channels.get(number)
            if channel is not None and channel.topic in names and log_ns >= start:
                yield Message(channel.topic, log_ns, content[22:])


def _parsed(opcode: int, content: bytes) -> Any:
    with needs_extra("reading bags in the MCAP format", "ros"):
        from mcap import records
        from mcap.data_stream import ReadDataStream
    return getattr(records, _CLASSES[opcode]).read(ReadDataStream(BytesIO(content)))


def _unpacked(file: BinaryIO, start_ns: int) -> Iterator[tuple[int, bytes]]:
    """Yield the records of a file and of its chunks, except chunks that end before ``start_ns``."""
    wanted = (_SCHEMA, _CHANNEL, _MESSAGE)
    for opcode, content in _records(file, (*wanted, _CHUNK)):
        if opcode != _CHUNK:
            yield opcode, content
            continue
        chunk = _parsed(_CHUNK, content)
        del content  # as large as the chunk, which has a copy
        if chunk.message_end_time >= start_ns:
            yield from _records(BytesIO(expand(chunk.data, chunk.compression, chunk.uncompressed_size)), wanted)


def _records(file: BinaryIO, opcodes: Collection[int]) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of the records with these opcodes until the data or the summary ends."""
    begun = file.tell()
    size = file.seek(0, os.SEEK_END)
    file.seek(begun)
    chunk = isinstance(file, BytesIO)
    # A chunk simply ends; a file must have a record that marks the end.
    while not chunk or file.tell() < size:
        opcode, length = struct.unpack("<BQ", _exactly(file, 9))
        if opcode in (_FOOTER, _DATA_END):
            return
        if file.tell() + length > size:
            raise RecordingError("the bag is truncated")
        if opcode not in opcodes:
            file.seek(length, os.SEEK_CUR)
        elif length > MAX_CHUNK_BYTES:
            raise RecordingError(f"has a record of {length} bytes, more than the {MAX_CHUNK_BYTES} allowed")
        else:
            yield opcode, _exactly(file, length)


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) != size:
        raise RecordingError("the bag is truncated")
    return data
