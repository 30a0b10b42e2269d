"""Image files: PNG checked before it is decoded, and the encoding of images in every format that is written."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import FormatError, FrameError
from ospc.formats.files import LARGEST_FILE, read_bytes, write_bytes
from ospc.formats.image_header import PNG_HEADER_END, PNG_SIGNATURE, png_chunk, read_header
from ospc.photometry.geometry import MOST_PIXELS

JPEG_QUALITY = 97
"""JPEG quality with a quantisation error of about one grey value."""


def read_png(path: str | Path) -> Image:
    """Read a PNG as stored, shape (height, width) or (height, width, channels), uint8 or uint16.

    Raises
    ------
    FormatError
        If it is not a PNG, is damaged, or has more than :data:`~ospc.photometry.geometry.MOST_PIXELS` pixels.
    """
    content = read_bytes(path, LARGEST_FILE)
    if not content.startswith(PNG_SIGNATURE):
        raise FormatError(f"{path}: not a PNG; convert it to a grey PNG with 8 or 16 bits")
    try:
        header = read_header(content, str(path))
    except FrameError as error:
        raise FormatError(f"{error} (damaged PNG)") from None
    if header.width * header.height > MOST_PIXELS:
        raise FormatError(f"{path}: has {header.width}×{header.height} pixels; at most {MOST_PIXELS} are allowed")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != (header.height, header.width):
        raise FormatError(f"{path}: the image cannot be decoded; write it again as a grey PNG with 8 or 16 bits")
    return np.asarray(image)


def write_png(path: str | Path, image: Image, description: str = "") -> Path:
    """Write an 8- or 16-bit image as PNG, atomically, and return its path; FormatError if that fails.

    ``description`` is stored as text that image programs display.
    """
    data = encoded(image, ".png", str(path))
    if description:
        # An iTXt chunk: keyword, no compression, no language, no translated keyword.
        content = b"Description\0\0\0\0\0" + description.encode("utf-8", "replace")
        data = data[:PNG_HEADER_END] + png_chunk(b"iTXt", content) + data[PNG_HEADER_END:]
    return write_bytes(path, data)


def encoded(
    image: Image, suffix: str, name: str, *, png_compression: int | None = None, jpeg_quality: int = JPEG_QUALITY
) -> bytes:
    """Return the content of an image file with this suffix, such as ``.png``; TIFF is not compressed.

    ``png_compression`` is the zlib level from 0 to 9: higher levels take several times as long for files a few per
    cent smaller. None uses run-length encoding, which is fastest and best for noisy images.

    Raises
    ------
    FormatError
        If the format cannot store an image of this type. The message begins with ``name``.
    """
    png = [] if png_compression is None else [cv2.IMWRITE_PNG_COMPRESSION, png_compression]
    jpeg, tiff = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality], [cv2.IMWRITE_TIFF_COMPRESSION, 1]
    options = {".png": png, ".jpg": jpeg, ".jpeg": jpeg, ".tif": tiff, ".tiff": tiff}
    done, data = cv2.imencode(suffix, image, options[suffix])
    if not done:
        raise FormatError(f"{name}: an image of shape {image.shape} and type {image.dtype} cannot become {suffix}")
    return bytes(data)
