"""All file parsers, with valid inputs to damage: each must return a result or raise one of our errors.

The tests try a few damaged inputs for each; ``benchmarks/fuzz_parsers.py`` tries a million.
"""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bag_samples import (
    FLIR,
    REALSENSE,
    START_NS,
    Sent,
    floats,
    header,
    images,
    metadata,
    write_bag1,
    write_bag2,
    write_mcap1,
    write_mcap2,
)
from file_targets import file_targets
from hypothesis import strategies as st
from image_samples import encoded, grey, jpeg_of_size, png_of_size
from photo_samples import dng, heic

from exif_segments import exif
from ospc.errors import OspcError
from ospc.recording import open_recording
from ospc.recording.bags.bag import IMAGE_TYPES, Bag
from ospc.recording.bags.carriers import carrier_of
from ospc.recording.bags.container import Encoding, Topic
from ospc.recording.bags.image_messages import read_image
from ospc.recording.bags.messages import MessageType
from ospc.recording.derived import Region
from ospc.recording.exif_photos import _photo
from ospc.recording.exposure_lists import read_list, read_times
from ospc.recording.image_source import ZipImages, decode_stored
from ospc.recording.options import DEFAULT
from ospc.recording.video import VideoStream


@dataclass(frozen=True)
class Target:
    """A parser with samples to damage.

    ``parse`` takes bytes and a folder to which it may write them.
    """

    parse: Callable[[bytes, Path], Any]
    samples: list[bytes]
    words: list[bytes] = field(default_factory=list)


def attempt(target: Target, data: bytes, folder: Path) -> bool:
    """Return whether the parser accepts the data; it may raise only our own errors, with one-line messages."""
    try:
        target.parse(data, folder)
    except OspcError as error:
        message = str(error)
        assert message.isprintable(), message
        assert len(message) < 2000, message
        return False
    return True


_NUMBERS = [b"\xff" * 4, b"\xff" * 8, b"\0" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\x01\0\0\0", b"\0\x10\0\0"]
_HOW = "=+-*<"


def damaged(target: Target) -> st.SearchStrategy[bytes]:
    """Generate samples that are truncated or have a few bytes changed, inserted, removed or repeated."""
    pieces = st.one_of(st.binary(min_size=1, max_size=4), st.sampled_from(_NUMBERS + target.words))
    edit = st.tuples(st.sampled_from(_HOW), st.floats(0, 1), pieces, st.integers(1, 40))
    return st.builds(_edited, st.sampled_from(target.samples), st.lists(edit, min_size=1, max_size=6))


def _edited(sample: bytes, edits: list[tuple[str, float, bytes, int]]) -> bytes:
    data = bytearray(sample)
    for how, share, piece, length in edits:
        place = int(share * len(data))
        if how == "=":
            data[place : place + len(piece)] = piece
        elif how == "+":
            data[place:place] = piece
        elif how == "-":
            del data[place : place + length]
        elif how == "*":
            data[place:place] = data[place : place + length]
        elif length > 30:
            del data[place:]
    return bytes(data)


def _checked_table(table: Any) -> None:
    assert np.all(np.isfinite(table.exposures_ms))
    assert np.all(table.exposures_ms > 0)
    assert np.all(np.diff(table.stamps_s) > 0)


def _list(name: str, read: Callable[[Path], Any]) -> Callable[[bytes, Path], None]:
    def parse(data: bytes, folder: Path) -> None:
        (folder / name).write_bytes(data)
        _checked_table(read(folder / name))

    return parse


def _image(data: bytes, _folder: Path) -> None:
    stored = decode_stored(data, "image")
    assert stored.pixels.ndim == 2


def _photo_of(name: str) -> Callable[[bytes, Path], None]:
    """Return the parser of a photograph's pixels and exposure, with the format of this file name."""

    def parse(data: bytes, folder: Path) -> None:
        assert decode_stored(data, name).pixels.ndim == 2
        (folder / name).write_bytes(data)
        assert 0 < _photo(folder / name)[0] < np.inf

    return parse


LIBRARIES = {"HEIC photograph": "pillow_heif", "raw photograph": "rawpy"}
"""Parsers that need an optional library."""


def _photo_targets() -> dict[str, Target]:
    found = {}
    if find_spec("pillow_heif"):
        colour = np.stack([grey(i, (32, 32)) for i in range(3)], axis=2)
        shots = [heic(colour, exif()), heic(grey(0, (32, 32)), exif(), quality=10)]
        found["HEIC photograph"] = Target(_photo_of("a.heic"), shots, [b"ispe", b"irot", b"grid"])
    if find_spec("rawpy"):
        mosaic = grey(0, (64, 48), np.uint16, 1024)
        found["raw photograph"] = Target(_photo_of("a.dng"), [dng(mosaic), dng(np.stack([mosaic] * 3, axis=2))])
    return found


def _zip(data: bytes, folder: Path) -> None:
    path = folder / "images.zip"
    path.write_bytes(data)
    source = ZipImages.of(path)
    for name in source.names:
        assert not Path(name).is_absolute()
        assert ".." not in Path(name).parts
        source.read(name)


def _exif(data: bytes, folder: Path) -> None:
    path = folder / "photo.jpg"
    path.write_bytes(data)
    assert 0 < _photo(path)[0] < np.inf


def _bag(name: str) -> Callable[[bytes, Path], None]:
    def parse(data: bytes, folder: Path) -> None:
        path = folder / name
        path.write_bytes(data)
        bag = Bag.at(path)
        names = {topic.name for topic in bag.topics}
        assert sum(len(message.data) for message in bag.messages(names)) < 2**28

    return parse


def _recorded_bag(data: bytes, folder: Path) -> None:
    path = folder / "made.mcap"
    path.write_bytes(data)
    for frame in open_recording(path):
        with suppress(OspcError):
            _ = frame.image


def _image_message(encoding: Encoding) -> Callable[[bytes, Path], None]:
    def parse(data: bytes, _folder: Path) -> None:
        kind = IMAGE_TYPES[data[0] % 2] if data else IMAGE_TYPES[0]
        read_image(data[1:], kind, encoding, "image")

    return parse


def _reading(data: bytes, _folder: Path) -> None:
    """Parse exposure metadata; the first byte selects the message type."""
    kind = (FLIR.kind, REALSENSE.kind, "diagnostic_msgs/msg/DiagnosticArray")[data[0] % 3 if data else 0]
    topic = Topic("/x", kind, 1, "cdr")
    carrier_of(topic, DEFAULT, "/own").readings()(data[1:])


_DESCRIBED_MESSAGE = struct.pack("<I8xIB3xIIB4x", 0x100, 1, 0, 0, 1, 0)
"""A header with an empty string, no numbers, an empty string and four zeros, in little-endian CDR."""


def _described(data: bytes, _folder: Path) -> None:
    MessageType("a_msgs/msg/A", "cdr", data.decode("utf-8", "replace")).decode(_DESCRIBED_MESSAGE)


def _video(data: bytes, folder: Path) -> None:
    path = folder / "walk.bin"
    path.write_bytes(data)
    with VideoStream(path) as stream:
        for index in range(3):
            assert stream.read(index).ndim == 2


def _videos(folder: Path) -> list[bytes]:
    """Return short videos of three frames in several containers."""
    found = []
    for name, code in (("a.mkv", "FFV1"), ("a.avi", "MJPG"), ("a.mp4", "mp4v")):
        writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter.fourcc(*code), 10.0, (64, 48))
        for i in range(3):
            writer.write(np.stack([grey(i, (64, 48))] * 3, axis=2))
        writer.release()
        found.append((folder / name).read_bytes())
    return found


def _region(data: bytes, _folder: Path) -> None:
    Region.parse(data.decode("utf-8", "replace"))


_WORDS = [
    b"nan",
    b"inf",
    b"-1",
    b"1e400",
    b"\n",
    b"\r",
    b",",
    b";",
    b"\t",
    b" ",
    b"#",
    b'"',
    b"../a.png",
    b"\xc2\xb5s",
]
_TABLES = [
    b"file,timestamp_s,exposure_ms,gain_db\na.png,0.0,1.5,0\nb.png,0.1,3,6\n",
    b"exposure\n-3\n-4\n",
    b"# id stamp exposure [us]\n0 1700000000000000000 1500\n1 1700000000050000000 3000\n",
    b"a.png 1.0\nb.png 2.0\n",
    b"time;shutter (s);iso\n1;0.01;100\n2;0.02;200\n",
]


def _zip_bytes() -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for i in range(3):
            archive.writestr(f"images/{i}.png", encoded(grey(i)))
    return out.getvalue()


def _messages(folder: Path) -> list[bytes]:
    """Return serialised messages of all supported types."""
    sent = images([grey(0, (8, 6))])
    sent += metadata([{"exposure_time": 1000, "gain": 1.0}], FLIR, "/flir")
    sent += metadata([{"json_data": json.dumps({"actual_exposure": 10, "gain_level": 16})}], REALSENSE, "/rs")
    pairs = [{"key": "ExposureTime", "value": "1000"}, {"key": "AnalogueGain", "value": "2.0"}]
    status = [{"level": 0, "name": "c", "message": "", "hardware_id": "", "values": pairs}]
    sent.append(Sent("/d", "diagnostic_msgs/msg/DiagnosticArray", {"header": header(5), "status": status}, START_NS))
    png = np.frombuffer(encoded(grey(0, (8, 6))), np.uint8)
    packed = {"header": header(START_NS), "format": "png", "data": png}
    sent.append(Sent("/e", "sensor_msgs/msg/CompressedImage", packed, START_NS))
    bag = Bag.at(write_bag2(folder / "messages", sent))
    found = {message.topic: message.data for message in bag.messages({t.name for t in bag.topics})}
    return [found[name] for name in ("/cam/image_raw", "/e", "/flir", "/rs", "/d")]


def _ros1_messages() -> list[bytes]:
    """Return a raw and a compressed image as serialised by ROS 1, each after a byte that selects its type."""

    def text(data: bytes) -> bytes:
        return struct.pack("<I", len(data)) + data

    pixels = grey(0, (8, 6))
    start = struct.pack("<III", 7, 1000, 5) + text(b"camera")
    raw = struct.pack("<II", 6, 8) + text(b"mono8") + struct.pack("<BI", 0, 8) + text(pixels.tobytes())
    return [b"\0" + start + raw, b"\1" + start + text(b"png") + text(encoded(pixels))]


def targets(folder: Path) -> dict[str, Target]:
    """Return all parsers by name; samples are created in the folder, which must be empty."""
    sent = images([grey(i, (12, 8)) for i in range(3)]) + floats([1.5, 3.0, 6.0])
    bags = {
        "bag1": [write_bag1(folder / "a", sent).read_bytes(), write_bag1(folder / "b", sent, "BZ2").read_bytes()],
        "sqlite": [next(write_bag2(folder / "c", sent).glob("*.db3")).read_bytes()],
        "mcap": [
            write_mcap2(folder / "d", sent).read_bytes(),
            write_mcap2(folder / "e", sent, "NONE").read_bytes(),
            write_mcap1(folder / "f", sent).read_bytes(),
        ],
    }
    raw, packed, flir, realsense, diagnostics = _messages(folder)
    colour = np.stack([grey(i) for i in range(3)], axis=2)
    pictures = [encoded(grey(), s) for s in (".png", ".jpg", ".tiff", ".bmp", ".pgm")]
    pictures += [encoded(colour, s) for s in (".png", ".jpg", ".tiff", ".bmp", ".ppm")]
    pictures += [encoded(grey(dtype=np.uint16, top=65536), s) for s in (".png", ".tiff", ".pgm")]
    jpeg = encoded(grey(), ".jpg")
    description = b"std_msgs/Header header\nfloat64[] a\nstring b\nuint8[4] c\n" + b"=" * 80
    description += b"\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    return {
        "times.txt": Target(
            _list("times.txt", read_times),
            [b"# a\n0 10.0 1.5\n1 10.1 3\n2 10.2 6.0\n", b"000 1e9 1\r\n001 1e10 2\r\n"],
            _WORDS,
        ),
        "exposures.csv": Target(_list("exposures.csv", read_list), _TABLES, _WORDS),
        "image_list.txt": Target(
            _list("image_list.txt", read_list), [b"a.ppm 0.5 2 8 0 0\nb.ppm 0.25 4 8 0 0\n"], _WORDS
        ),
        "image file": Target(_image, [*pictures, png_of_size(10**6, 10**6), jpeg_of_size(65000, 65000)]),
        "images.zip": Target(_zip, [_zip_bytes()], [b"../", b"/", b"PK\x01\x02", b"PK\x05\x06"]),
        "EXIF": Target(_exif, [jpeg[:2] + exif() + jpeg[2:]]),
        **_photo_targets(),
        "ROS 1 bag": Target(_bag("made.bag"), bags["bag1"]),
        "ROS 2 bag, sqlite3": Target(_bag("made.db3"), bags["sqlite"]),
        "ROS 2 bag, mcap": Target(_bag("made.mcap"), bags["mcap"]),
        "recording in mcap": Target(_recorded_bag, bags["mcap"][1:2]),
        "image message": Target(_image_message("cdr"), [b"\0" + raw, b"\1" + packed]),
        "image message of ROS 1": Target(_image_message("ros1"), _ros1_messages()),
        "exposure message": Target(_reading, [b"\0" + flir, b"\1" + realsense, b"\2" + diagnostics]),
        "description of messages": Target(
            _described, [description], [b"[]", b"[<=9]", b"a_msgs/A a", b"wstring w\n"]
        ),
        "video": Target(_video, _videos(folder)),
        "region": Target(_region, [b"1,2,3,4"], _WORDS),
        **{name: Target(*parts) for name, parts in file_targets(folder).items()},
    }
