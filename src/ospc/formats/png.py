"""Pictures of one channel as PNG, checked before they are decoded."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import FormatError
from ospc.formats.files import read_bytes, write_bytes

MOST_PIXELS = 2**27
"""Pixels up to which a picture is decoded: twice the largest sensor in ordinary use."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_LARGEST_FILE = 2**30


@dataclass(frozen=True)
class PngHeader:
    """What a PNG says of itself before any pixel.

    Attributes
    ----------
    width, height
        Size in pixels.
    bit_depth
        Bits per channel: 1, 2, 4, 8 or 16.
    """

    width: int
    height: int
    bit_depth: int


def read_png(path: str | Path) -> tuple[PngHeader, Image]:
    """Read a PNG as it is stored: depth and channels unchanged.

    Returns
    -------
    header
        What the file says of itself.
    image
        Shape (height, width) or (height, width, channels), uint8 or uint16.

    Raises
    ------
    FormatError
        If it is no PNG, is damaged, or is larger than :data:`MOST_PIXELS`.
    """
    content = read_bytes(path, _LARGEST_FILE)
    header = _checked_header(content, Path(path))
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != (header.height, header.width):
        raise FormatError(f"{path}: the picture cannot be decoded; write it again as a grey PNG of 8 or 16 bit")
    return header, image


def write_png(path: str | Path, image: Image) -> Path:
    """Write an image of 8 or 16 bit as PNG, atomically, and return its path.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    done, encoded = cv2.imencode(".png", image)
    if not done:
        raise FormatError(f"{path}: an image of shape {image.shape} and type {image.dtype} cannot be stored as PNG")
    return write_bytes(path, encoded.tobytes())


def _checked_header(content: bytes, place: Path) -> PngHeader:
    """Return the header of a complete PNG: signature, every chunk's checksum, and the end marker are there."""
    damaged = FormatError(f"{place}: a damaged or cut-off PNG; copy or write it again")
    if not content.startswith(_SIGNATURE):
        raise FormatError(f"{place}: not a PNG; convert it to a grey PNG of 8 or 16 bit")
    position, header = len(_SIGNATURE), None
    while position + 12 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        end = position + 8 + length
        if end + 4 > len(content):
            raise damaged
        if zlib.crc32(content[position + 4 : end]) != struct.unpack_from(">I", content, end)[0]:
            raise damaged
        if header is None:
            if kind != b"IHDR" or length != 13:
                raise damaged
            header = PngHeader(*struct.unpack_from(">IIB", content, position + 8))
            if not 0 < header.width * header.height <= MOST_PIXELS:
                raise FormatError(
                    f"{place}: {header.width}x{header.height} pixels; pictures of up to {MOST_PIXELS} pixels are read"
                )
        if kind == b"IEND" and header is not None:
            return header
        position = end + 4
    raise damaged
