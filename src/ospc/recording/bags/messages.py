"""Messages of any type, decoded by following the description of their type; nothing of the bag is ever executed."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np

from ospc.recording.bags.wire import FORMATS, DamagedMessageError, Encoding, Wire
from ospc.recording.wording import escaped, quoted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

MAX_DESCRIPTION_CHARACTERS = 200_000
"""Longer descriptions of a type are refused; that of the longest usual message has 20 000."""

MAX_ITEMS = 100_000
"""Messages with more values are refused; arrays of numbers count once."""

_MAX_DEPTH = 16
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
_TEXTS = ("string", "wstring")
_STAMP = [("sec", (_BASE, ("int32", 0))), ("nanosec", (_BASE, ("uint32", 0)))]
_ALWAYS: dict[str, list[tuple[str, Any]]] = {
    "builtin_interfaces/msg/Time": _STAMP,
    "builtin_interfaces/msg/Duration": _STAMP,
}
_STEP = re.compile(r"([A-Za-z]\w*)|\[(\d{1,6})\]", re.ASCII)


class MessageType:
    """A type of message with those it is made of.

    Parameters
    ----------
    name
        Such as ``std_msgs/msg/Float64``.
    description
        Its definition, followed by those of the types in it, as bags hold them.
    idl
        Whether the definition is in IDL rather than in ROS's own language.
    encoding
        How messages are serialised.

    Raises
    ------
    DamagedMessageError
        If the definition cannot be understood.
    """

    def __init__(self, name: str, description: str, encoding: Encoding, *, idl: bool = False) -> None:
        self._name = name
        self._encoding = encoding
        if len(description) > MAX_DESCRIPTION_CHARACTERS:
            raise DamagedMessageError(f"the type {quoted(name)} has a description of {len(description)} characters")
        self._fields: Mapping[str, Sequence[tuple[str, Any]]] = _ALWAYS | _parsed(name, description, idl=idl)
        if name not in self._fields:
            raise DamagedMessageError(f"the type {quoted(name)} is not described")

    def decode(self, data: bytes) -> dict[str, Any]:
        """Return the fields of a message: numbers, texts, arrays of numbers, and lists and dictionaries of these.

        Raises
        ------
        DamagedMessageError
            If the message does not fit its type.
        """
        return _Decoder(Wire(data, self._encoding), self._fields).message(self._name, 0)


class _Decoder:
    """Follows the description of a type through one message."""

    def __init__(self, wire: Wire, fields: Mapping[str, Sequence[tuple[str, Any]]]) -> None:
        self._wire = wire
        self._fields = fields
        self._items = 0

    def message(self, name: str, depth: int) -> dict[str, Any]:
        if depth > _MAX_DEPTH or name not in self._fields:
            raise DamagedMessageError(f"the type {quoted(name)} is not described")
        self._count(1)
        return {field: self._value(description, depth) for field, description in self._fields[name]}

    def _value(self, description: Any, depth: int) -> Any:
        kind, detail = int(description[0]), description[1]
        if kind == _BASE:
            return self._single(detail[0])
        if kind == _NAME:
            return self.message(detail, depth + 1)
        length = detail[1] if kind == _ARRAY else self._wire.count()
        (inner_kind, inner), count = detail[0], int(length)
        if int(inner_kind) == _BASE and inner[0] in FORMATS:
            data = self._wire.array(inner[0], count)
            self._count(1)
            return np.frombuffer(data, dtype=self._wire.order + FORMATS[inner[0]])
        self._count(count)
        return [self._value(detail[0], depth) for _ in range(count)]

    def _single(self, name: str) -> Any:
        self._count(1)
        if name in _TEXTS:
            if name == "wstring":
                raise DamagedMessageError("messages with wide text cannot be read")
            return self._wire.text()
        if name not in FORMATS:
            raise DamagedMessageError(f"messages with values of type {quoted(name)} cannot be read")
        return self._wire.number(name)

    def _count(self, items: int) -> None:
        self._items += items
        if self._items > MAX_ITEMS:
            raise DamagedMessageError(f"the message has more than {MAX_ITEMS} values")


def value_at(message: Mapping[str, Any], field: str) -> Any:
    """Return a field of a message, such as ``exposure_time``, ``camera_info.header`` or ``shutter[0]``.

    Raises
    ------
    DamagedMessageError
        If there is no such field.
    """
    value: Any = message
    for step in _STEP.finditer(field):
        name, index = step.groups()
        try:
            value = value[name] if name else value[int(index)]
        except (KeyError, IndexError, TypeError):
            raise DamagedMessageError(f"the message has no field {field}; it has {_known(message)}") from None
    return value


def is_field(text: str) -> bool:
    """Tell whether a text can name a field of a message."""
    return re.fullmatch(r"[A-Za-z]\w*(?:\[\d{1,6}\]|\.[A-Za-z]\w*)*", text, re.ASCII) is not None


def _known(message: Mapping[str, Any]) -> str:
    return escaped(", ".join(list(message)[:12])[:200])


def _parsed(name: str, description: str, *, idl: bool) -> dict[str, Sequence[tuple[str, Any]]]:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    try:
        if not idl:
            found = get_types_from_msg(description, name)
        else:
            found = {}
            for part in _idl_files(description):
                found.update(get_types_from_idl(part))
    except Exception:
        # The parser fails in ways it does not name.
        raise DamagedMessageError(f"the description of the type {quoted(name)} cannot be understood") from None
    return {key: fields for key, (_, fields) in found.items()}


def _idl_files(description: str) -> list[str]:
    """Split what a bag holds into files: each begins with a line of 80 ``=`` and one with ``IDL: `` and its name."""
    parts = re.split(r"={80}\r?\nIDL: [^\n]*\n", description)
    return [part for part in parts if part.strip()]
