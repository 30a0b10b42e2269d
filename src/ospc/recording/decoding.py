"""Decoding image files to grey images in bounded memory."""

from __future__ import annotations

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import FrameError
from ospc.formats.image_header import ImageHeader, read_header
from ospc.recording.channel import Channel
from ospc.recording.frame import check_decoded_size
from ospc.recording.image_formats import format_of
from ospc.recording.pixel_layout import StoredImage

# The EXIF orientation is ignored: response and vignette belong to the axes of the sensor.
_STORED = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_GREY, _COLOUR = cv2.IMREAD_GRAYSCALE | _STORED, cv2.IMREAD_COLOR | _STORED
_JPEG_START, _PNG_START = b"\xff\xd8", b"\x89PNG"
_DEFLATE_EXPANDS = 1032
"""Largest compression ratio of PNG: deflate copies 258 bytes with at least two bits."""


def decode_grey(data: bytes, name: str) -> Image:
    """Decode an image file as :func:`decode_stored`; colour becomes luma, 0.299 R + 0.587 G + 0.114 B."""
    return decode_stored(data, name).pixels


def decode_stored(data: bytes, name: str, channel: Channel | None = None) -> StoredImage:
    """Decode the content of an image file, called ``name`` in messages, to one channel; by default to luma.

    The name tells HEIC and raw photographs, the content all others. FrameError if it is not an image, truncated,
    damaged, too large, or does not have 8 or 16 bits.
    """
    optional = format_of(name)
    if optional is not None:
        return optional.decode(data, name, channel)
    header = read_header(data, name)
    check_decoded_size((header.width, header.height), header.channels, header.bits, name)
    if header.bits > 16:
        raise FrameError(f"{name}: has {header.bits} bits a channel; convert it to 8 or 16 bit PNG")
    damaged = FrameError(f"{name}: the image is damaged and cannot be decoded; copy or download it again")
    if not _can_hold(data, header):
        raise damaged
    colour = header.channels > 2
    wanted = channel or Channel.LUMINANCE
    # JPEG stores luma. For other formats the decoders truncate when converting to grey; OpenCV's conversion rounds.
    in_colour = colour and not (data.startswith(_JPEG_START) and wanted is Channel.LUMINANCE)
    try:
        image: Image | None = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), _COLOUR if in_colour else _GREY)
        if in_colour and image is not None and image.ndim == 3:
            image = wanted.of(image)
    except (cv2.error, MemoryError):
        image = None
    if image is None:
        raise damaged
    if image.dtype not in (np.uint8, np.uint16):
        raise FrameError(f"{name}: has {image.dtype} values; convert it to PNG of 8 or 16 bits")
    return StoredImage(image, colour)


def _can_hold(data: bytes, header: ImageHeader) -> bool:
    """Tell whether a file can hold as many pixels as its header states; decoding one that cannot would take long."""
    pixels = header.width * header.height
    if data.startswith(_JPEG_START):
        # Each block of 8×8 pixels takes at least one bit, for its mean.
        return pixels // 64 <= 8 * len(data)
    if data.startswith(_PNG_START):
        return pixels * header.bits // 8 <= _DEFLATE_EXPANDS * len(data)
    return True
