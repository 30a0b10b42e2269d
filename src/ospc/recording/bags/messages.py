"""Messages of any type, deserialised by the package rosbags from the definition of their type.

The package compiles a reader from the definition, which is part of the bag and not trusted. Therefore only plain
names are accepted, constants are dropped, and the sizes of readers and messages are limited.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ospc.errors import RecordingError, escaped, needs_extra, quoted
from ospc.recording.bags.container import Encoding

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MAX_DEFINITION_CHARACTERS = 200_000
"""Maximum length of a definition; the longest common one has 20 000 characters."""

MAX_FIELDS = 2000
"""Maximum number of fields in a definition: code is generated for each."""

MAX_MESSAGE_BYTES = 2**20
"""Maximum size of messages whose type the bag defines: messages with exposures have a few kilobytes."""

NS_PER_S = 10**9
"""Nanoseconds per second; stamps in messages have both units."""

_SHOWN_FIELDS, _SHOWN_CHARACTERS = 12, 200
"""Maximum number of fields that an error lists, and the length of this list."""

_WITHOUT_EXPOSURES = ("header", "stamp", "roi")
"""Inner messages that contain no exposures."""

_DEEPEST = 2
"""Maximum depth of inner messages whose fields are listed."""

_TYPE_NAME = re.compile(r"[A-Za-z]\w{0,99}(?:/[A-Za-z]\w{0,99}){1,3}", re.ASCII)
_FIELD_NAME = re.compile(r"[A-Za-z]\w{0,99}", re.ASCII)
_STEP = re.compile(r"([A-Za-z]\w*)|\[(\d{1,6})\]", re.ASCII)
_IDL_FILE = re.compile(r"={80}\r?\nIDL: [^\n]*\n")
"""Bags concatenate IDL files; each begins with a line of 80 equals signs and a line with its name."""

_BASE, _NAME, _ARRAY = 1, 2, 3
"""Kinds of fields in rosbags: a number or text, a message, and an array of fixed length. 4 is a sequence."""

_DRIVER_TYPES = {
    "flir_camera_msgs/msg/ImageMetaData": "std_msgs/Header header\nuint64 camera_time\nint16 brightness\n"
    "uint32 exposure_time\nuint32 max_exposure_time\nfloat32 gain\n",
    "realsense2_camera_msgs/msg/Metadata": "std_msgs/Header header\nstring json_data\n",
}
"""Definitions of messages with exposures that are not part of ROS, for bags without definitions."""

_Types = Mapping[str, tuple[Sequence[Any], Sequence[tuple[str, Any]]]]


class DamagedMessageError(RecordingError):
    """A message does not match its type."""


class MessageType:
    """A type of message that can be deserialised, such as ``std_msgs/msg/Float64``.

    Its definition is followed by those of the types it contains, as stored in bags. If it is empty, the type must be
    part of ROS or of a supported driver.

    Raises
    ------
    DamagedMessageError
        If the definition is missing or invalid.
    """

    def __init__(self, name: str, encoding: Encoding, definition: str = "", *, idl: bool = False) -> None:
        self._name = name
        self._ros1 = encoding == "ros1"
        self._trusted = not definition
        self._store = _standard_types(ros1=self._ros1) if self._trusted else _defined_types(name, definition, idl=idl)
        if name not in self._store.fielddefs:
            raise DamagedMessageError(
                f"the bag does not define the type {quoted(name)}; record it as .mcap or use 'ros2 bag convert'"
            )

    def numbers(self) -> list[str]:
        """Return the fields that are numbers; fields of inner messages have a dot, such as ``info.shutter``."""
        return list(self._numbers_in(self._name, ""))

    def _numbers_in(self, name: str, prefix: str) -> Iterator[str]:
        for field, (kind, detail) in self._store.fielddefs[name][1]:
            if kind == _BASE and detail[0] != "string":
                yield prefix + field
            elif kind == _NAME and field not in _WITHOUT_EXPOSURES and prefix.count(".") < _DEEPEST:
                yield from self._numbers_in(str(detail), f"{prefix}{field}.")

    def decode(self, data: bytes) -> Any:
        """Return a message as an object with its fields as attributes; arrays of numbers are NumPy arrays.

        Raises
        ------
        DamagedMessageError
            If the message does not match its type.
        """
        if not self._trusted and len(data) > MAX_MESSAGE_BYTES:
            raise DamagedMessageError(f"the message has {len(data)} bytes, more than the {MAX_MESSAGE_BYTES} allowed")
        deserialize = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
        try:
            return deserialize(memoryview(data), self._name)
        except Exception:
            # The package raises undocumented errors for damaged messages.
            raise DamagedMessageError(f"the message does not match its type {quoted(self._name)}") from None


@cache
def _standard_types(*, ros1: bool) -> Typestore:
    with needs_extra("reading bags", "ros"):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, definition in _DRIVER_TYPES.items():
        store.register(get_types_from_msg(definition, name))
    return store


def _defined_types(name: str, definition: str, *, idl: bool) -> Typestore:
    """Return the types that a bag defines."""
    with needs_extra("reading bags", "ros"):
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    if len(definition) > MAX_DEFINITION_CHARACTERS:
        raise DamagedMessageError(f"the definition of {quoted(name)} is too long ({len(definition)} characters)")
    store = get_typestore(Stores.EMPTY)
    try:
        if idl:
            parts = [part for part in _IDL_FILE.split(definition) if part.strip()]
            parsed = {key: value for part in parts for key, value in get_types_from_idl(part).items()}
        else:
            parsed = get_types_from_msg(definition, name)
        _check(parsed)
        fields: Any = {key: ([], found) for key, (_, found) in parsed.items() if key not in store.fielddefs}
        store.register(fields)
        store.get_msgdef(name)
    except Exception:
        # The parser and the generator raise undocumented errors.
        raise DamagedMessageError(f"the definition of the type {quoted(name)} is invalid") from None
    return store


def _check(types: _Types) -> None:
    """Raise a ValueError for names that are not plain, and fields that would make readers or messages too large."""
    # All remaining fields take at least one byte, so that a message has no more values than bytes.
    fields = 0
    for name, (_, found) in types.items():
        if not (_TYPE_NAME.fullmatch(name) and found):
            raise ValueError(name)
        for field, (kind, detail) in found:
            (inner, inner_detail), length = detail if kind > _NAME else ((kind, detail), 1)
            named = inner != _NAME or _TYPE_NAME.fullmatch(inner_detail)
            if not (_FIELD_NAME.fullmatch(field) and named and (kind != _ARRAY or length > 0)):
                raise ValueError(field)
            # The generator writes code for every element of a fixed array that is not numeric.
            numeric = inner == _BASE and inner_detail[0] != "string"
            fields += length if kind == _ARRAY and not numeric else 1
    if fields > MAX_FIELDS:
        raise ValueError(fields)


def value_at(message: Any, field: str) -> Any:
    """Return a field such as ``exposure_time``, ``info.header`` or ``shutter[0]``; DamagedMessageError if missing."""
    value = message
    for step in _STEP.finditer(field):
        name, index = step.groups()
        known = _fields(value)
        if name in known:
            value = getattr(value, name)
        elif index and isinstance(value, list | array | np.ndarray) and int(index) < len(value):
            value = value[int(index)]
        else:
            raise DamagedMessageError(f"the message has no field {field}; it has {shown(_fields(message))}")
    return value


def shown(fields: Sequence[str]) -> str:
    """Return field names as a text of limited length."""
    return escaped(", ".join(fields[:_SHOWN_FIELDS])[:_SHOWN_CHARACTERS])


def _fields(value: Any) -> list[str]:
    """Return the field names of a message from rosbags, from a ROS 2 node, or of another object."""
    of_node = getattr(value, "get_fields_and_field_types", dict)
    declared = getattr(value, "__dataclass_fields__", None) or of_node()
    names = declared or getattr(value, "__dict__", ()) or getattr(value, "__slots__", ())
    return [name for name in names if not name.startswith("_")]  # rosbags adds its own


def stamp_ns_of(message: Any) -> int:
    """Return the time stamp of a message, or of the camera info in it, in nanoseconds; 0 if it has none."""
    header = getattr(message, "header", None) or getattr(getattr(message, "camera_info", None), "header", None)
    stamp = getattr(header, "stamp", None)
    return int(getattr(stamp, "sec", 0)) * NS_PER_S + int(getattr(stamp, "nanosec", 0))


def is_field(text: str) -> bool:
    """Return whether a text is a valid field name."""
    return re.fullmatch(r"[A-Za-z]\w*(?:\[\d{1,6}\]|\.[A-Za-z]\w*)*", text, re.ASCII) is not None
