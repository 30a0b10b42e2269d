"""Images in ROS messages: ``sensor_msgs/Image`` and ``sensor_msgs/CompressedImage``.

Sources: the definitions of these messages, the names of encodings in ``sensor_msgs/image_encodings.h``, and the
format text that ``compressed_image_transport`` writes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import Image
from ospc.errors import FrameError
from ospc.recording.bags.wire import Encoding, Wire
from ospc.recording.bayer import Mosaic
from ospc.recording.channel import Channel
from ospc.recording.decoding import decode_stored
from ospc.recording.pixel_layout import StoredImage
from ospc.recording.wording import quoted

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (RAW, COMPRESSED)


@dataclass(frozen=True)
class _Layout:
    """How the pixels of an encoding are stored.

    Attributes
    ----------
    channels
        Values a pixel.
    bits
        Bits a value.
    order
        Which values are blue, green and red, for colour; which one is grey, for luma among chroma.
    """

    channels: int
    bits: int
    order: tuple[int, ...] = ()


_ENCODINGS = {
    "mono8": _Layout(1, 8),
    "8UC1": _Layout(1, 8),
    "mono16": _Layout(1, 16),
    "16UC1": _Layout(1, 16),
    "rgb8": _Layout(3, 8, (2, 1, 0)),
    "bgr8": _Layout(3, 8, (0, 1, 2)),
    "8UC3": _Layout(3, 8, (0, 1, 2)),
    "rgba8": _Layout(4, 8, (2, 1, 0)),
    "bgra8": _Layout(4, 8, (0, 1, 2)),
    "rgb16": _Layout(3, 16, (2, 1, 0)),
    "bgr16": _Layout(3, 16, (0, 1, 2)),
    "16UC3": _Layout(3, 16, (0, 1, 2)),
    "rgba16": _Layout(4, 16, (2, 1, 0)),
    "bgra16": _Layout(4, 16, (0, 1, 2)),
    "yuv422": _Layout(2, 8, (1,)),
    "uyvy": _Layout(2, 8, (1,)),
    "yuv422_yuy2": _Layout(2, 8, (0,)),
    "yuyv": _Layout(2, 8, (0,)),
    "nv21": _Layout(1, 8),
    "nv24": _Layout(1, 8),
} | {f"bayer_{pattern}{bits}": _Layout(1, bits) for pattern in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)}


def read_stamp_ns(data: bytes, encoding: Encoding) -> int:
    """Return the time stamp of a message that begins with a header, in nanoseconds; 0 where the camera gave none.

    Raises
    ------
    DamagedMessageError
        If the message ends early.
    """
    return _stamp_ns(Wire(data, encoding), encoding)


def read_image(data: bytes, kind: str, encoding: Encoding, name: str, channel: Channel | None = None) -> StoredImage:
    """Read an image message.

    Parameters
    ----------
    data
        The message.
    kind
        One of :data:`IMAGE_TYPES`.
    encoding
        How it is serialised.
    name
        What to call it in a message to the user.
    channel
        Channel to take of colour; luma where None.

    Raises
    ------
    FrameError
        If it holds no image, or one that is damaged or of an encoding that is no photograph.
    DamagedMessageError
        If the message ends early.
    """
    wire = Wire(data, encoding)
    _stamp_ns(wire, encoding)
    wire.text()
    return _raw(wire, name, channel) if kind == RAW else _compressed(wire, name, channel)


def _stamp_ns(wire: Wire, encoding: Encoding) -> int:
    if encoding == "ros1":
        wire.number("uint32")
    seconds = int(wire.number("uint32" if encoding == "ros1" else "int32"))
    return seconds * 10**9 + int(wire.number("uint32"))


def _raw(wire: Wire, name: str, channel: Channel | None) -> StoredImage:
    height, width = wire.count(), wire.count()
    encoding = wire.text()
    swapped = bool(wire.number("uint8"))
    step = wire.count()
    data = wire.data(wire.count())
    layout = _ENCODINGS.get(encoding)
    if layout is None:
        raise FrameError(
            f"{name}: images with the encoding {quoted(encoding)} cannot be read; record mono, Bayer or RGB"
        )
    row_bytes = width * layout.channels * layout.bits // 8
    if not width or not height or step < row_bytes or len(data) < step * (height - 1) + row_bytes:
        raise FrameError(
            f"{name}: its {len(data)} bytes do not hold {width}x{height} pixels of {encoding}; leave it out"
        )
    pixels = _pixels(data, (height, row_bytes), step, layout, swapped=swapped)
    if len(layout.order) == 3:
        ordered = np.ascontiguousarray(pixels.reshape(height, width, layout.channels)[:, :, list(layout.order)])
        return StoredImage((channel or Channel.LUMINANCE).of(ordered), colour=True)
    if layout.order or encoding.startswith("nv"):
        if channel not in (None, Channel.LUMINANCE):
            raise FrameError(f"{name}: of {encoding} only the luminance can be taken, not {channel.value}")
        luma = pixels.reshape(height, width, layout.channels)[:, :, layout.order[0] if layout.order else 0]
        return StoredImage(np.ascontiguousarray(luma), colour=True)
    return StoredImage(pixels, mosaic=Mosaic(encoding[6:10]) if encoding.startswith("bayer_") else None)


def _pixels(data: memoryview, shape: tuple[int, int], step: int, layout: _Layout, *, swapped: bool) -> Image:
    """Return the values of all rows without what fills them up to their step."""
    rows = np.lib.stride_tricks.as_strided(np.frombuffer(data, np.uint8), shape, (step, 1), writeable=False)
    pixels: Image = np.ascontiguousarray(rows)
    if layout.bits == 16:
        return pixels.view(">u2" if swapped else "<u2").astype(np.uint16)
    return pixels


def _compressed(wire: Wire, name: str, channel: Channel | None) -> StoredImage:
    said = wire.text()
    data = bytes(wire.data(wire.count()))
    if "compressedDepth" in said:
        raise FrameError(f"{name}: holds depth, not grey values; choose another topic with --image-topic")
    stored = decode_stored(data, name, channel)
    pattern = said[6:10] if said.startswith("bayer_") else ""
    if stored.colour or pattern not in Mosaic.PATTERNS:
        return stored
    return StoredImage(stored.pixels, mosaic=Mosaic(pattern))
