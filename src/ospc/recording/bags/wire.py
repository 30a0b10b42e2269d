"""Numbers and text in a serialised ROS message, read one after the other and never beyond its end.

Sources: the ROS 1 serialisation (little-endian, without padding) and the Common Data Representation of the OMG DDSI
specification, version 1, as ROS 2 writes it: four bytes that state the byte order, then values aligned to their size.
"""

from __future__ import annotations

import struct
from typing import Literal

from ospc.errors import RecordingError

Encoding = Literal["ros1", "cdr"]

FORMATS = {
    "bool": "B",
    "byte": "B",
    "char": "B",
    "octet": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
"""Format characters of :mod:`struct` for the basic types of ROS; all but strings."""

_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
_CDR_HEADER_BYTES = 4


class DamagedMessageError(RecordingError):
    """A message does not hold what its type says it holds."""


class Wire:
    """A serialised message and a place in it.

    Parameters
    ----------
    data
        The message.
    encoding
        How it is serialised.

    Raises
    ------
    DamagedMessageError
        If its header states no byte order that is known.
    """

    def __init__(self, data: bytes, encoding: Encoding) -> None:
        self._data = memoryview(data)
        self._cdr = encoding == "cdr"
        self._order = "<"
        if self._cdr:
            order = _ORDERS.get(bytes(self._data[:2]))
            if order is None or len(data) < _CDR_HEADER_BYTES:
                raise DamagedMessageError("the message is not in plain CDR")
            self._order = order
            self._data = self._data[_CDR_HEADER_BYTES:]
        self._place = 0

    def number(self, kind: str) -> float | int:
        """Return the next number; ``kind`` is a key of :data:`FORMATS`."""
        layout = struct.Struct(self._order + FORMATS[kind])
        self._align(layout.size)
        try:
            (value,) = layout.unpack_from(self._data, self._place)
        except struct.error:
            raise DamagedMessageError("the message ends early") from None
        self._place += layout.size
        number: float | int = value
        return number

    def count(self) -> int:
        """Return the next length of a text or sequence."""
        return int(self.number("uint32"))

    def text(self) -> str:
        """Return the next text."""
        data = bytes(self.data(self.count()))
        # CDR counts the zero byte that ends a text.
        return (data.removesuffix(b"\0") if self._cdr else data).decode("utf-8", "replace")

    def data(self, length: int) -> memoryview:
        """Return so many bytes, not copied."""
        end = self._place + length
        if end > len(self._data):
            raise DamagedMessageError("the message ends early")
        part = self._data[self._place : end]
        self._place = end
        return part

    def array(self, kind: str, length: int) -> memoryview:
        """Return so many numbers of a kind as bytes, in the byte order of :attr:`order`."""
        size = struct.calcsize("<" + FORMATS[kind])
        if length:
            self._align(size)
        return self.data(length * size)

    @property
    def order(self) -> str:
        """Byte order as :mod:`struct` and NumPy write it."""
        return self._order

    @property
    def left(self) -> int:
        """Number of bytes not yet read."""
        return len(self._data) - self._place

    def _align(self, size: int) -> None:
        if self._cdr:
            self._place += -self._place % size
