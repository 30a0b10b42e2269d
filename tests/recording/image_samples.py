"""Sample images and image files."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np

from ospc.arrays import Image


def grey(seed: int = 0, size: tuple[int, int] = (24, 16), dtype: type = np.uint8, top: int = 256) -> Image:
    """Return noise of the given width and height."""
    return np.random.default_rng(seed).integers(0, top, size[::-1]).astype(dtype)


def encoded(image: Image, suffix: str = ".png") -> bytes:
    """Return the bytes of an image file."""
    done, data = cv2.imencode(suffix, image)
    assert done
    return data.tobytes()


def png_of_size(width: int, height: int) -> bytes:
    """Return a small PNG file whose header states any size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(b"\0" * 1000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + body + chunk(b"IEND", b"")


def jpeg_of_size(width: int, height: int) -> bytes:
    """Return a JPEG file whose header states any size below 65536."""
    data = bytearray(encoded(grey(), ".jpg"))
    place = data.index(b"\xff\xc0") + 5
    data[place : place + 4] = struct.pack(">HH", height, width)
    return bytes(data)
