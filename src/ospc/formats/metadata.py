"""Metadata of photographs, copied from one file to another: EXIF, XMP and the colour profile.

Sources: ITU-T T.81 (JPEG segments), Exif 3.0, XMP part 3, ICC.1 annex B, PNG specification third edition (eXIf).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress
from itertools import takewhile

from ospc.formats.image_header import DamagedError, jpeg_segments, png_chunks
from ospc.formats.png import HEADER_END, chunk

WITH_METADATA = frozenset({".png", ".jpg", ".jpeg"})
"""Suffixes of files that get metadata."""

_EXIF = b"Exif\0\0"
_COPIED = (_EXIF, b"http://ns.adobe.com/xap/1.0/\0", b"ICC_PROFILE\0")
"""Beginnings of the JPEG segments that stay valid; an index of further pictures in the file would not."""

_JPEG, _PNG = b"\xff\xd8", b"\x89PNG\r\n\x1a\n"
_APP1, _APP2, _START_OF_SCAN = 0xE1, 0xE2, 0xDA
"""Markers of JPEG segments: EXIF and XMP, colour profile, and the picture itself."""

_LARGEST_SEGMENT = 65533
"""Bytes that a segment holds besides the two of its length."""


def with_metadata(image: bytes, original: bytes) -> bytes:
    """Return an encoded image with the metadata of the file it was made from.

    JPEG to JPEG keeps EXIF, XMP and colour profile; from or to PNG only EXIF is kept. Other formats are returned as
    they are. The original is a JPEG or PNG file, or an EXIF block that begins with 'Exif'; damaged metadata count as
    none, and the image has none of its own.
    """
    if image.startswith(_JPEG) and original.startswith(_JPEG):
        kept = (_segment(kind, content) for kind, content in _segments(original) if content.startswith(_COPIED))
        return _JPEG + b"".join(kept) + image[2:]
    blocks = (content for _, content in _segments(original) if content.startswith(_EXIF))
    exif = original if original.startswith(_EXIF) else next(blocks, None)
    if exif is None:
        return image
    if image.startswith(_JPEG) and len(exif) <= _LARGEST_SEGMENT:
        return _JPEG + _segment(_APP1, exif) + image[2:]
    if image.startswith(_PNG):
        return image[:HEADER_END] + chunk(b"eXIf", exif[len(_EXIF) :]) + image[HEADER_END:]
    return image


def _segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield marker and content of application segments before the picture; a PNG has EXIF as a JPEG would."""
    with suppress(struct.error, DamagedError):
        if data.startswith(_JPEG):
            before = takewhile(lambda segment: segment[0] != _START_OF_SCAN, jpeg_segments(data))
            yield from ((marker, bytes(content)) for marker, content in before if marker in (_APP1, _APP2))
        elif data.startswith(_PNG):
            yield from ((_APP1, _EXIF + content) for kind, content in png_chunks(data) if kind == b"eXIf")


def _segment(marker: int, content: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, 2 + len(content)) + content
