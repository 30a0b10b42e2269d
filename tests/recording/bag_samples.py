"""Sample bags written by independent packages: rosbags, and mcap with its ROS support."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap_ros1.writer import Writer as Mcap1Writer
from mcap_ros2.writer import Writer as Mcap2Writer
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ospc.arrays import Image

START_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000

Make = Callable[[str, Any], Any]


@dataclass(frozen=True)
class Sent:
    """A message to write.

    ``content`` has its fields as nested dictionaries; ``kind`` is its type as spelt in ROS 2.
    """

    topic: str
    kind: str
    content: dict[str, Any]
    log_ns: int


@dataclass(frozen=True)
class Definition:
    """A message type unknown to the packages."""

    kind: str
    text: str


FLIR = Definition(
    "flir_camera_msgs/msg/ImageMetaData",
    "std_msgs/Header header\nuint64 camera_time\nint16 brightness\nuint32 exposure_time\nuint32 max_exposure_time\n"
    "float32 gain\n",
)
REALSENSE = Definition("realsense2_camera_msgs/msg/Metadata", "std_msgs/Header header\nstring json_data\n")
ARAVIS = Definition(
    "camera_aravis/msg/ExtendedCameraInfo",
    "sensor_msgs/CameraInfo camera_info\nfloat64 exposure_time\nfloat64 gain\nfloat64 black_level\n",
)
SEQUENCE = Definition(
    "image_exposure_msgs/msg/ExposureSequence",
    "std_msgs/Header header\nfloat32[] shutter\nfloat32 gain\nuint16 white_balance_blue\nuint16 white_balance_red\n",
)
CUSTOM = Definition(
    "acme_msgs/msg/Frame",
    "std_msgs/Header header\nfloat32 shutter\nstring name\nsensor_msgs/RegionOfInterest window\n",
)
NAMED = Definition(
    "acme_msgs/msg/Named", "std_msgs/Header header\nfloat64[1] shutter_100us\nfloat32 analog_gain_db\n"
)
TWO_GAINS = Definition(
    "acme_msgs/msg/TwoGains",
    "std_msgs/Header header\nfloat64 exposure_ms\nfloat32 analog_gain\nfloat32 digital_gain\n",
)
DEFINITIONS = (FLIR, REALSENSE, ARAVIS, SEQUENCE, CUSTOM, NAMED, TWO_GAINS)


def header(stamp_ns: int, ros1: bool = False) -> dict[str, Any]:
    stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
    return ({"seq": 7} if ros1 else {}) | {"stamp": stamp, "frame_id": "camera"}


def image_message(
    image: Image, stamp_ns: int, encoding: str | None = None, pad: int = 0, swapped: bool = False
) -> dict[str, Any]:
    """Return a raw image message; rows may be padded, and 16-bit values byte-swapped."""
    height, width = image.shape[:2]
    stored = image.astype(">u2") if swapped else image
    rows = np.frombuffer(np.ascontiguousarray(stored).tobytes(), np.uint8).reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=171)
    return {
        "header": header(stamp_ns),
        "height": height,
        "width": width,
        "encoding": encoding or ("mono8" if image.dtype == np.uint8 else "mono16"),
        "is_bigendian": int(swapped),
        "step": rows.shape[1],
        "data": rows.ravel(),
    }


def images(frames: Sequence[Image], topic: str = "/cam/image_raw", stamped: bool = True, **how: Any) -> list[Sent]:
    stamps = [START_NS + i * STEP_NS for i in range(len(frames))]
    return [
        Sent(topic, "sensor_msgs/msg/Image", image_message(image, stamp * stamped, **how), stamp + 3_000_000)
        for image, stamp in zip(frames, stamps, strict=True)
    ]


def floats(
    values: Sequence[float], topic: str = "/cam/exposure", kind: str = "Float64", late_ns: int = 4_000_000
) -> list[Sent]:
    """Return messages of plain numbers, without time stamps of their own."""
    return [
        Sent(topic, f"std_msgs/msg/{kind}", {"data": value}, START_NS + i * STEP_NS + late_ns)
        for i, value in enumerate(values)
    ]


def metadata(values: Sequence[dict[str, Any]], definition: Definition, topic: str) -> list[Sent]:
    stamps = [START_NS + i * STEP_NS for i in range(len(values))]
    return [
        Sent(topic, definition.kind, {"header": header(stamp)} | value, stamp + 5_000_000)
        for value, stamp in zip(values, stamps, strict=True)
    ]


@dataclass
class _Typed:
    """Creates messages of the package rosbags from nested dictionaries."""

    store: Any
    ros1: bool
    known: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        for definition in DEFINITIONS:
            self.store.register(get_types_from_msg(definition.text, definition.kind))

    def message(self, kind: str, content: dict[str, Any]) -> Any:
        values = {}
        for name, (node, detail) in self.store.fielddefs[kind][1]:
            value = content.get(name)
            if int(node) == 2:
                values[name] = self.message(detail, value or {})
            elif int(node) in (3, 4) and int(detail[0][0]) == 2:
                values[name] = [self.message(detail[0][1], item) for item in value or []]
            elif int(node) in (3, 4) and detail[0][1][0] != "string":
                empty = np.zeros(detail[1] if int(node) == 3 else 0)
                values[name] = np.asarray(empty if value is None else value, dtype=detail[0][1][0])
            elif int(node) in (3, 4):
                values[name] = value or []
            else:
                values[name] = value if value is not None else ("" if detail[0] == "string" else 0)
        return self.store.types[kind](**values)


def _typed(ros1: bool) -> _Typed:
    return _Typed(get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE), ros1)


def write_bag1(path: Path, sent: Sequence[Sent], compression: str | None = None) -> Path:
    """Write a ROS 1 bag with rosbags."""
    typed = _typed(ros1=True)
    path = path.with_suffix(".bag")
    writer = Bag1Writer(path)
    if compression is not None:
        writer.set_compression(Bag1Writer.CompressionFormat[compression])
    with writer:
        connections: dict[str, Any] = {}
        for message in sorted(sent, key=lambda m: m.log_ns):
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(message.topic, message.kind, typestore=typed.store)
            data = typed.store.serialize_ros1(typed.message(message.kind, message.content), message.kind)
            writer.write(connections[message.topic], message.log_ns, data)
    return path


def write_bag2(path: Path, sent: Sequence[Sent], plugin: str = "SQLITE3", compression: str | None = None) -> Path:
    """Write a ROS 2 bag, a folder, with rosbags."""
    typed = _typed(ros1=False)
    writer = Bag2Writer(path, version=9, storage_plugin=StoragePlugin[plugin])
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for message in sorted(sent, key=lambda m: m.log_ns):
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(message.topic, message.kind, typestore=typed.store)
            data = typed.store.serialize_cdr(typed.message(message.kind, message.content), message.kind)
            writer.write(connections[message.topic], message.log_ns, data)
    return path


def _definition(typed: _Typed, kind: str) -> str:
    return str(typed.store.generate_msgdef(kind, ros_version=1 if typed.ros1 else 2)[0])


def _namespaces(value: Any) -> Any:
    if isinstance(value, dict):
        return SimpleNamespace(**{key: _namespaces(item) for key, item in value.items()})
    if isinstance(value, list):
        return [_namespaces(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def write_mcap2(path: Path, sent: Sequence[Sent], compression: str = "ZSTD", chunk_size: int = 2000) -> Path:
    """Write a ROS 2 bag with mcap and mcap-ros2-support, which have their own serialisation."""
    typed = _typed(ros1=False)
    path = path.with_suffix(".mcap")
    with path.open("wb") as file:
        writer = Mcap2Writer(file, chunk_size=chunk_size, compression=CompressionType[compression])
        schemas: dict[str, Any] = {}
        for message in sorted(sent, key=lambda m: m.log_ns):
            if message.kind not in schemas:
                schemas[message.kind] = writer.register_msgdef(message.kind, _definition(typed, message.kind))
            writer.write_message(
                message.topic, schemas[message.kind], _namespaces(message.content), log_time=message.log_ns
            )
        writer.finish()
    return path


def write_mcap1(path: Path, sent: Sequence[Sent]) -> Path:
    """Write a ROS 1 bag in MCAP with mcap and mcap-ros1-support; messages are serialised by hand."""
    typed = _typed(ros1=True)
    path = path.with_suffix(".mcap")
    with path.open("wb") as file:
        writer = Mcap1Writer(file, chunk_size=2000)
        for message in sorted(sent, key=lambda m: m.log_ns):
            kind = message.kind.replace("/msg/", "/")
            shape = type("Ros1", (), {"_type": kind, "_full_text": _definition(typed, message.kind)})
            instance = shape()
            data = _by_hand(kind, message.content)
            instance.serialize = lambda buffer, data=data: buffer.write(data)
            writer.write_message(message.topic, instance, log_time=message.log_ns)
        writer.finish()
    return path


def _by_hand(kind: str, content: dict[str, Any]) -> bytes:
    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    if kind == "std_msgs/Float64":
        return struct.pack("<d", content["data"])
    assert kind == "sensor_msgs/Image", kind
    out = BytesIO()
    stamp = content["header"]["stamp"]
    out.write(struct.pack("<III", 7, stamp["sec"], stamp["nanosec"]) + text("camera"))
    out.write(struct.pack("<II", content["height"], content["width"]) + text(content["encoding"]))
    data = content["data"].tobytes()
    out.write(struct.pack("<BII", content["is_bigendian"], content["step"], len(data)) + data)
    return out.getvalue()


WRITERS: dict[str, Callable[[Path, Sequence[Sent]], Path]] = {
    "ROS 1, rosbags": write_bag1,
    "ROS 1 bz2, rosbags": lambda path, sent: write_bag1(path, sent, "BZ2"),
    "ROS 1 lz4, rosbags": lambda path, sent: write_bag1(path, sent, "LZ4"),
    "ROS 2 sqlite3, rosbags": write_bag2,
    "ROS 2 sqlite3 zstd messages, rosbags": lambda path, sent: write_bag2(path, sent, compression="MESSAGE"),
    "ROS 2 mcap, rosbags": lambda path, sent: write_bag2(path, sent, "MCAP"),
    "ROS 2 mcap zstd, rosbags": lambda path, sent: write_bag2(path, sent, "MCAP", "STORAGE"),
    "ROS 2 mcap, mcap": lambda path, sent: write_mcap2(path, sent, "NONE"),
    "ROS 2 mcap zstd, mcap": write_mcap2,
    "ROS 2 mcap lz4, mcap": lambda path, sent: write_mcap2(path, sent, "LZ4"),
    "ROS 1 mcap zstd, mcap": write_mcap1,
}
