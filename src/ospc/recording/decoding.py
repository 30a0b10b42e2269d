"""From the bytes of an image file to a grey image, in bounded memory."""

from __future__ import annotations

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import FrameError
from ospc.recording.channel import Channel
from ospc.recording.image_header import ImageHeader, read_header
from ospc.recording.pixel_layout import StoredImage

MAX_DECODED_BYTES = 512 * 2**20
"""Images that would need more, with all channels they are stored with, are refused before they are decoded."""

MAX_FILE_BYTES = 256 * 2**20
"""Larger image files are refused before they are read."""

# The orientation noted in a photograph is ignored: response and vignette belong to the sensor's own axes.
_STORED = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_GREY, _COLOUR = cv2.IMREAD_GRAYSCALE | _STORED, cv2.IMREAD_COLOR | _STORED
_JPEG_START, _PNG_START = b"\xff\xd8", b"\x89PNG"
_DEFLATE_EXPANDS = 1032
"""Two bits for a copy of 258 bytes: the compression of PNG cannot do better."""


def decode_grey(data: bytes, name: str) -> Image:
    """Decode an image file to grey values; colour becomes luma, 0.299 R + 0.587 G + 0.114 B.

    Parameters
    ----------
    data
        The whole file.
    name
        What to call it in a message.

    Returns
    -------
    Image
        Shape (height, width), uint8 or uint16 as stored.

    Raises
    ------
    FrameError
        If it is not an image, truncated, damaged, too large, or not of 8 or 16 bit.
    """
    return decode_stored(data, name).pixels


def decode_stored(data: bytes, name: str, channel: Channel | None = None) -> StoredImage:
    """Decode an image file; of colour a channel is taken, luma unless another is asked for.

    Raises
    ------
    FrameError
        If it is not an image, truncated, damaged, too large, or not of 8 or 16 bit.
    """
    header = read_header(data, name)
    _check_header(header, name)
    if not _can_hold(data, header):
        raise FrameError(f"{name}: the image is damaged and cannot be decoded; copy or download it again")
    colour = header.channels > 2
    wanted = channel or Channel.LUMINANCE
    # JPEG stores luma. Elsewhere the decoders' own conversions truncate, half a grey value off; OpenCV's rounds.
    in_colour = colour and not (data.startswith(_JPEG_START) and wanted is Channel.LUMINANCE)
    try:
        image: Image | None = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), _COLOUR if in_colour else _GREY)
        if in_colour and image is not None and image.ndim == 3:
            image = wanted.of(image)
    except (cv2.error, MemoryError):
        image = None
    if image is None:
        raise FrameError(f"{name}: the image is damaged and cannot be decoded; copy or download it again")
    if image.dtype not in (np.uint8, np.uint16):
        raise FrameError(f"{name}: has {image.dtype} values, not 8 or 16 bit; convert it to PNG")
    return StoredImage(image, colour)


def _can_hold(data: bytes, header: ImageHeader) -> bool:
    """Tell whether a file can hold as many pixels as its header states; otherwise decoding it would take long."""
    pixels = header.width * header.height
    if data.startswith(_JPEG_START):
        # Each block of 8×8 pixels takes a bit at the least, for its mean.
        return pixels // 64 <= 8 * len(data)
    if data.startswith(_PNG_START):
        return pixels * header.bits // 8 <= _DEFLATE_EXPANDS * len(data)
    return True


def _check_header(header: ImageHeader, name: str) -> None:
    """Refuse what would need too much memory, before it is decoded."""
    if header.width * header.height * header.channels * max(header.bits, 8) > 8 * MAX_DECODED_BYTES:
        raise FrameError(
            f"{name}: its header states {header.width}x{header.height} pixels, which need more than the "
            f"{MAX_DECODED_BYTES} bytes allowed; the file is damaged, or scale the images down"
        )
    if header.bits > 16:
        raise FrameError(f"{name}: has {header.bits} bits a channel; convert it to 8 or 16 bit PNG")
