"""Bag messages: types that a bag defines are supported, and hostile definitions do no harm."""

from __future__ import annotations

import bz2
import os
import sys
from io import BytesIO
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from bag_samples import FLIR, REALSENSE, floats, images, metadata, write_bag1, write_bag2, write_mcap2
from image_samples import grey
from mcap.writer import IndexType, Writer

from ospc.errors import RecordingError
from ospc.recording.bags.bag import Bag
from ospc.recording.bags.container import Topic, expand
from ospc.recording.bags.messages import MAX_MESSAGE_BYTES, DamagedMessageError, MessageType, value_at

NAME = "a_msgs/msg/A"
SEPARATOR = "=" * 80 + "\n"


def sent_and_topics(write, path: Path) -> tuple[dict[str, bytes], dict[str, Topic]]:
    sent = metadata([{"exposure_time": 1234, "gain": 1.5, "brightness": -7}], FLIR, "/flir")
    sent += metadata([{"json_data": "{}"}], REALSENSE, "/rs")
    bag = Bag.at(write(path, sent))
    topics = {topic.name: topic for topic in bag.topics}
    return {message.topic: message.data for message in bag.messages(topics)}, topics


@pytest.mark.parametrize("write", [write_bag1, write_bag2, write_mcap2])
def test_the_definition_in_a_bag_and_the_known_one_give_the_same_fields(write, tmp_path: Path) -> None:
    data, topics = sent_and_topics(write, tmp_path / "made")
    for name, fields in (("/flir", ("exposure_time", "gain", "brightness")), ("/rs", ("json_data",))):
        topic = topics[name]
        assert topic.definition
        defined = MessageType(topic.type, topic.encoding, topic.definition, idl=topic.idl).decode(data[name])
        known = MessageType(topic.type, topic.encoding).decode(data[name])
        for field in (*fields, "header.stamp.sec", "header.stamp.nanosec", "header.frame_id"):
            assert value_at(defined, field) == value_at(known, field)
    assert value_at(MessageType(FLIR.kind, topics["/flir"].encoding).decode(data["/flir"]), "brightness") == -7


IDL = f"""{SEPARATOR}IDL: a_msgs/msg/A
module a_msgs {{ module msg {{ struct A {{ double exposure; sequence<float> gains; }}; }}; }};
"""


def test_definitions_in_idl_are_read() -> None:
    data = bytes.fromhex("00010000") + b"\0\0\0\0\0\0\x24\x40" + b"\x01\0\0\0" + b"\0\0\0\x40"
    message = MessageType(NAME, "cdr", IDL, idl=True).decode(data)
    assert value_at(message, "exposure") == 10
    assert value_at(message, "gains[0]") == 2


HOSTILE = {
    "fixed array of a billion texts": "string[1000000000] a\n",
    "many fixed arrays of texts": "".join(f"string[1000] a{i}\n" for i in range(1000)),
    "many fields": "".join(f"uint8 a{i}\n" for i in range(5000)),
    "a type of no fields": f"B[] b\n{SEPARATOR}MSG: a_msgs/B\nuint8 C=1\n",
    "a type that takes no bytes": f"B[] b\n{SEPARATOR}MSG: a_msgs/B\nuint8[0] c\n",
    "a type that contains itself": "A a\n",
    "types that contain each other": f"B b\n{SEPARATOR}MSG: a_msgs/B\nA a\n",
    "an undefined type": "B b\n",
    "wide text": "wstring a\n",
    "code in a name": "uint8 a:__import__('os').system('false')\n",
    "code in a type": "a_msgs/B\");__import__('os').abort()#  b\n",
    "not a definition": "\0\1\2",
    "too long": "uint8 a\n" + "# \n" * 100_000,
}


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_definitions_are_refused(case: str, encoding, tmp_path: Path) -> None:
    with pytest.raises(DamagedMessageError) as caught:
        MessageType(NAME, encoding, HOSTILE[case]).decode(bytes([0, 1, 0, 0]) + bytes(100))
    assert str(caught.value).isprintable()


def test_constants_of_a_definition_are_dropped() -> None:
    kind = MessageType(NAME, "cdr", 'string B=\'"""); import this\'\nuint8 a\n')
    assert value_at(kind.decode(bytes([0, 1, 0, 0, 7])), "a") == 7
    with pytest.raises(DamagedMessageError, match="no field B; it has a"):
        value_at(kind.decode(bytes([0, 1, 0, 0, 7])), "B")
    assert "this" not in sys.modules


def test_large_messages_of_defined_types_are_refused() -> None:
    kind = MessageType(NAME, "ros1", "uint8[] a\n")
    assert len(value_at(kind.decode(b"\3\0\0\0abc"), "a")) == 3
    with pytest.raises(DamagedMessageError, match="more than the"):
        kind.decode(bytes(MAX_MESSAGE_BYTES + 1))


def test_a_type_that_nobody_defines_is_named() -> None:
    with pytest.raises(DamagedMessageError, match="does not define the type 'a_msgs/msg/A'"):
        MessageType(NAME, "cdr")


ZEROS = bytes(10_000_000)
COMPRESSED = {"bz2": bz2.compress(ZEROS), "lz4": lz4.frame.compress(ZEROS), "zstd": zstandard.compress(ZEROS)}


@pytest.mark.parametrize("compression", COMPRESSED)
def test_what_expands_to_another_size_than_stated_is_refused(compression: str) -> None:
    data = COMPRESSED[compression]
    assert expand(data, compression, len(ZEROS)) == ZEROS
    for size in (1000, len(ZEROS) - 1, len(ZEROS) + 1):
        with pytest.raises(RecordingError, match="stated size"):
            expand(data, compression, size)
    with pytest.raises(RecordingError, match="more than the"):
        expand(data, compression, 2**40)


def test_attachments_are_skipped_and_neither_chunks_nor_a_summary_are_needed(tmp_path: Path) -> None:
    given = Bag.at(write_mcap2(tmp_path / "given", images([grey(0)]) + floats([2.0])))
    out = BytesIO()
    writer = Writer(
        out,
        index_types=IndexType.NONE,
        repeat_channels=False,
        repeat_schemas=False,
        use_chunking=False,
        use_statistics=False,
        use_summary_offsets=False,
    )
    writer.start("ros2", "test")
    channels = {}
    for topic in given.topics:
        schema = writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
        channels[topic.name] = writer.register_channel(topic.name, "cdr", schema)
    messages = list(given.messages(channels))
    for message in messages:
        writer.add_message(channels[message.topic], message.log_ns, message.data, message.log_ns)
    writer.finish()
    data, size = out.getvalue(), 2**33
    after_header = 8 + 9 + int.from_bytes(data[9:17], "little")
    with (tmp_path / "made.mcap").open("wb") as file:
        file.write(data[:after_header] + b"\x09" + size.to_bytes(8, "little"))
        # A hole in a sparse file takes no disk space.
        file.seek(size, os.SEEK_CUR)
        file.write(data[after_header:])
    made = Bag.at(tmp_path / "made.mcap")
    assert [topic.name for topic in made.topics] == [topic.name for topic in given.topics]
    assert list(made.messages(channels)) == messages
