"""Images in the messages of a bag: ``sensor_msgs/Image`` and ``sensor_msgs/CompressedImage``.

Sources: the definitions of these messages, the encodings in ``sensor_msgs/image_encodings.h``, and the format text
written by ``compressed_image_transport``.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ospc.arrays import Image, IntArray
from ospc.errors import FrameError, RecordingError, escaped, quoted
from ospc.recording.bags.bag import RAW, Bag
from ospc.recording.bags.container import Encoding, Message, Topic
from ospc.recording.bags.messages import DamagedMessageError, MessageType, stamp_ns_of
from ospc.recording.channel import Channel, Mosaic
from ospc.recording.image_source import decode_stored
from ospc.recording.pixel_layout import StoredImage


@dataclass(frozen=True)
class _Layout:
    """Values per pixel, bits per value, and the positions of blue, green and red, or of luma among chroma."""

    channels: int
    bits: int
    order: tuple[int, ...] = ()


_GREY8, _GREY16 = _Layout(1, 8), _Layout(1, 16)
_ENCODINGS = {
    **dict.fromkeys(("mono8", "8UC1", "nv21", "nv24"), _GREY8),
    **dict.fromkeys(("mono16", "16UC1"), _GREY16),
    **dict.fromkeys(("bgr8", "8UC3"), _Layout(3, 8, (0, 1, 2))),
    **dict.fromkeys(("bgr16", "16UC3"), _Layout(3, 16, (0, 1, 2))),
    **dict.fromkeys(("yuv422", "uyvy"), _Layout(2, 8, (1,))),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), _Layout(2, 8, (0,))),
    "rgb8": _Layout(3, 8, (2, 1, 0)),
    "rgb16": _Layout(3, 16, (2, 1, 0)),
    "rgba8": _Layout(4, 8, (2, 1, 0)),
    "bgra8": _Layout(4, 8, (0, 1, 2)),
    "rgba16": _Layout(4, 16, (2, 1, 0)),
    "bgra16": _Layout(4, 16, (0, 1, 2)),
    **{f"bayer_{pattern}8": _GREY8 for pattern in Mosaic.PATTERNS},
    **{f"bayer_{pattern}16": _GREY16 for pattern in Mosaic.PATTERNS},
}
"""Layouts of the supported ROS encodings."""


def read_stamp_ns(data: bytes, topic: Topic) -> int:
    """Return the time stamp of an image message in nanoseconds; 0 if it has none or is damaged."""
    try:
        return max(0, stamp_ns_of(_type(topic.type, topic.encoding).decode(data)))
    except DamagedMessageError:
        return 0  # reading the image raises the error


def read_image(data: bytes, kind: str, encoding: Encoding, name: str, channel: Channel | None = None) -> StoredImage:
    """Read a message of one of the :data:`IMAGE_TYPES`; the image is called ``name`` in messages to the user.

    Raises
    ------
    FrameError
        If the message has no image, or the image is damaged or does not have grey values.
    DamagedMessageError
        If the message is not of this type.
    """
    message = _type(kind, encoding).decode(data)
    return image_of(message, name, channel) if kind == RAW else _compressed(message, name, channel)


@cache
def _type(kind: str, encoding: Encoding) -> MessageType:
    return MessageType(kind, encoding)


def image_of(message: Any, name: str, channel: Channel | None = None) -> StoredImage:
    """Return the image in a ``sensor_msgs/msg/Image`` of any library; FrameError as for :func:`read_image`."""
    height, width, step, encoding = message.height, message.width, message.step, message.encoding
    layout = _ENCODINGS.get(encoding)
    if layout is None:
        raise FrameError(
            f"{name}: images with the encoding {quoted(encoding)} are not supported; record mono, Bayer or RGB"
        )
    row_bytes = width * layout.channels * layout.bits // 8
    if not width or not height or step < row_bytes or len(message.data) < step * (height - 1) + row_bytes:
        raise FrameError(
            f"{name}: its {len(message.data)} bytes are not {width}×{height} pixels of {quoted(encoding)}; remove it"
        )
    # Without the padding at the ends of rows.
    rows = np.lib.stride_tricks.as_strided(_bytes(message.data), (height, row_bytes), (step, 1), writeable=False)
    pixels: Image = np.ascontiguousarray(rows)
    if layout.bits == 16:
        pixels = pixels.view(">u2" if message.is_bigendian else "<u2").astype(np.uint16)
    if len(layout.order) == 3:
        return StoredImage.of(pixels.reshape(height, width, layout.channels)[:, :, list(layout.order)], channel)
    if layout.order or encoding.startswith("nv"):
        if channel not in (None, Channel.LUMINANCE, Channel.ALL):
            raise FrameError(f"{name}: {encoding} has no {channel.value} channel; use --channel luminance")
        luma = pixels.reshape(height, width, layout.channels)[:, :, layout.order[0] if layout.order else 0]
        return StoredImage(np.ascontiguousarray(luma), Channel.LUMINANCE)
    return StoredImage(pixels, mosaic=Mosaic(encoding[6:10]) if encoding.startswith("bayer_") else None)


def _bytes(data: Any) -> npt.NDArray[np.uint8]:
    """Return the bytes of an image, which are an array, a list or a buffer, depending on the library."""
    if isinstance(data, list | tuple | np.ndarray):
        return np.ascontiguousarray(data, np.uint8)
    return np.frombuffer(data, np.uint8)


def _compressed(message: Any, name: str, channel: Channel | None) -> StoredImage:
    said = message.format
    if "compressedDepth" in said:
        raise FrameError(f"{name}: is a depth image without grey values; choose another topic with --image-topic")
    stored = decode_stored(message.data.tobytes(), name, channel)
    pattern = said[6:10] if said.startswith("bayer_") else ""
    if stored.channel is not None or pattern not in Mosaic.PATTERNS:
        return stored
    return StoredImage(stored.pixels, mosaic=Mosaic(pattern))


_READ_ON = 64
"""Number of messages read to reach an image ahead; an image further ahead is found by time."""


class ImageStream:
    """Messages of a topic by number: reading continues if a message is ahead; others are found by time.

    ``log_ns`` are the times at which messages were recorded in nanoseconds, in reading order, shape (messages,). A
    stream is thread-safe; reads are serialised.
    """

    def __init__(self, bag: Bag, topic: Topic, log_ns: IntArray, channel: Channel | None) -> None:
        self._bag, self._topic, self._log_ns, self._channel = bag, topic, log_ns, channel
        self._lock = threading.Lock()
        self._numbered: Iterator[tuple[int, Message]] = iter(())
        self._start_ns, self._next = 0, len(log_ns)

    def again(self) -> ImageStream:
        """Return a stream of the same images with its own position."""
        return ImageStream(self._bag, self._topic, self._log_ns, self._channel)

    def label(self, number: int) -> str:
        """Return the name of an image in messages."""
        return f"{escaped(self._topic.name)}[{number}]"

    def image(self, number: int) -> StoredImage:
        """Return the image in a message; FrameError if it cannot be read."""
        label, data = self.label(number), self.read(number)
        try:
            return read_image(data, self._topic.type, self._topic.encoding, label, self._channel)
        except DamagedMessageError as error:
            raise FrameError(f"{label}: {error}; remove it") from None

    def read(self, number: int) -> bytes:
        """Return a message; FrameError if the bag is damaged at this message or has changed."""
        with self._lock:
            log_ns = int(self._log_ns[number])
            ahead = 0 <= number - self._next < _READ_ON and log_ns >= self._start_ns
            self._next = len(self._log_ns)  # after an error, reading starts again
            if not ahead:
                # The bag yields later messages in the order of their numbers.
                numbers = map(int, np.flatnonzero(self._log_ns >= log_ns))
                self._numbered = zip(numbers, self._bag.messages((self._topic.name,), log_ns), strict=False)
                self._start_ns = log_ns
            try:
                found = next((message for place, message in self._numbered if place == number), None)
            except RecordingError as error:
                raise FrameError(str(error)) from None
            if found is None or found.log_ns != log_ns:
                raise FrameError(f"{self._bag.path}: image {self.label(number)} is missing; the bag has changed")
            self._next = number + 1
            return found.data
