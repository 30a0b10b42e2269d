"""Metadata of photographs, copied from one file to another: EXIF, XMP and the colour profile.

Sources: ITU-T T.81 (JPEG segments), Exif 3.0, XMP part 3, ICC.1 annex B, PNG specification third edition (eXIf).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

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
    they are.

    Parameters
    ----------
    image
        The new file, just encoded, without metadata of its own.
    original
        The JPEG or PNG file that it was made from, or an EXIF block that begins with 'Exif'; damaged metadata
        count as none.
    """
    if image.startswith(_JPEG) and original.startswith(_JPEG):
        segments = b"".join(segment for segment in _jpeg_segments(original) if segment[4:].startswith(_COPIED))
        return _JPEG + segments + image[2:]
    exif = _exif(original)
    if exif is None:
        return image
    if image.startswith(_JPEG) and len(exif) + len(_EXIF) <= _LARGEST_SEGMENT:
        return _JPEG + struct.pack(">BBH", 0xFF, _APP1, 2 + len(_EXIF) + len(exif)) + _EXIF + exif + image[2:]
    if image.startswith(_PNG):
        return image[:HEADER_END] + chunk(b"eXIf", exif) + image[HEADER_END:]
    return image


def _exif(data: bytes) -> bytes | None:
    """Return the EXIF block of a JPEG or PNG, or of itself; None if there is none."""
    if data.startswith(_EXIF):
        return data[len(_EXIF) :]
    if data.startswith(_JPEG):
        segments = (s for s in _jpeg_segments(data) if s[1] == _APP1 and s[4:].startswith(_EXIF))
        return next((segment[4 + len(_EXIF) :] for segment in segments), None)
    return next((content for kind, content in _png_chunks(data) if kind == b"eXIf"), None)


def _jpeg_segments(data: bytes) -> Iterator[bytes]:
    """Yield the application segments, with marker and length, up to the picture."""
    place = 2
    while place + 4 <= len(data) and data[place] == 0xFF and data[place + 1] != _START_OF_SCAN:
        end = place + 2 + int.from_bytes(data[place + 2 : place + 4])
        if data[place + 1] in (_APP1, _APP2) and end <= len(data):
            yield data[place:end]
        place = end


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = len(_PNG) if data.startswith(_PNG) else len(data)
    while place + 8 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, place)
        place += 12 + length
        if place <= len(data):
            yield kind, data[place - 4 - length : place - 4]
