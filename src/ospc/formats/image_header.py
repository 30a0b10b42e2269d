"""Headers of encoded images, checked before decoding, and the copying of EXIF, XMP and colour profiles.

A decoder allocates the size in the header, and returns part of the image if the file is truncated. Checking the bytes
first limits memory and rejects incomplete files.

Sources: PNG specification (W3C, third edition; eXIf), ITU-T T.81 (JPEG segments), Netpbm's pgm(5) and ppm(5), the
Windows bitmap header, TIFF 6.0, Exif 3.0, XMP part 3, ICC.1 annex B.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import takewhile

from ospc.errors import FrameError


@dataclass(frozen=True)
class ImageHeader:
    """Stored size in pixels, number of channels (a palette counts as colour), and bits per channel."""

    width: int
    height: int
    channels: int
    bits: int


def read_header(data: bytes, name: str) -> ImageHeader:
    """Read the header of an encoded image, and check that its ``data`` are complete.

    Raises
    ------
    FrameError
        If the format is unknown, or the image, called ``name`` in the message, is truncated or damaged.
    """
    for magic, parse in _FORMATS:
        if data.startswith(magic):
            try:
                header = parse(data)
            except (struct.error, IndexError):
                raise FrameError(f"{name}: the image is truncated; copy or download it again") from None
            except _DamagedError as error:
                raise FrameError(f"{name}: {error}; copy or download it again") from None
            if header.width <= 0 or header.height <= 0:
                raise FrameError(f"{name}: its header states a size of {header.width}×{header.height} pixels")
            return header
    if not data:
        raise FrameError(f"{name}: the file is empty; copy or download it again")
    raise FrameError(f"{name}: its content is not PNG, JPEG, TIFF, BMP, PGM or PPM; convert it to PNG or remove it")


class _DamagedError(Exception):
    """The bytes do not follow the format."""


PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_HEADER_END = 33
"""Size of the signature and the first chunk of a PNG, IHDR, which is constant."""

_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_PNG_BITS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
"""Channels and allowed bits for each colour type of the PNG specification; a palette (3) is decoded to colour."""


def _png(data: bytes) -> ImageHeader:
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    if data[12:16] != b"IHDR" or bits not in _PNG_BITS.get(colour, ()):
        raise _DamagedError("its PNG header is damaged")
    for _chunk in _png_chunks(data):
        pass  # checks all checksums up to the last chunk
    return ImageHeader(width, height, _PNG_CHANNELS[colour], bits)


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Yield kind and content of every chunk of a PNG file; struct.error or _DamagedError if it is truncated."""
    place = 8
    kind = b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, place)
        end = place + 8 + length
        (checksum,) = struct.unpack_from(">I", data, end)
        if zlib.crc32(memoryview(data)[place + 4 : end]) != checksum:
            raise _DamagedError(f"a checksum of its PNG data at byte {place} is wrong")
        yield kind, memoryview(data)[place + 8 : end]
        place = end + 4


def png_chunk(kind: bytes, content: bytes) -> bytes:
    """Return a chunk of a PNG file with its length and checksum."""
    whole = kind + content
    return struct.pack(">I", len(content)) + whole + struct.pack(">I", zlib.crc32(whole))


JPEG_START = b"\xff\xd8"
_JPEG_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_JPEG_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_END = 0xD9
"""Markers of the segments with the size (SOF0 to SOF15, without tables), and of the end of the image."""


def _jpeg(data: bytes) -> ImageHeader:
    header = None
    for kind, content in _jpeg_segments(data):
        if kind in _JPEG_SIZES and header is None:
            bits, height, width, channels = struct.unpack_from(">BHHB", content)
            header = ImageHeader(width, height, channels, bits)
    if header is None:
        raise _DamagedError("its JPEG header states no size")
    return header


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Yield marker and content of every segment of a JPEG file; struct.error or _DamagedError if it is truncated."""
    # Segments are skipped by length, so that the end marker of a thumbnail inside one does not count.
    place = 2
    while marker := _JPEG_MARKER.search(data, place):
        kind, place = data[marker.end() - 1], marker.end()
        if kind == _JPEG_END:
            return
        (length,) = struct.unpack_from(">H", data, place)
        if place + length > len(data):
            break
        yield kind, memoryview(data)[place + 2 : place + length]
        place += length
    raise _DamagedError("the image is truncated: it has no end marker")


_PNM_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PNM_HEADER = re.compile(rb"P[56]" + _PNM_GAP + (rb"(\d{1,9})" + _PNM_GAP) * 2 + rb"(\d{1,5})\s")
_PNM_HEADER_BYTES = 4096
"""Bytes searched for the header, which may contain comments."""


def _pnm(data: bytes) -> ImageHeader:
    found = _PNM_HEADER.match(data[:_PNM_HEADER_BYTES])
    if found is None:
        raise _DamagedError("its PGM or PPM header is damaged")
    width, height, limit = (int(group) for group in found.groups())
    header = ImageHeader(width, height, 3 if data[1:2] == b"6" else 1, 16 if limit > 255 else 8)
    if len(data) - found.end() < width * height * header.channels * header.bits // 8:
        raise _DamagedError("the image is truncated")
    return header


def _bmp(data: bytes) -> ImageHeader:
    start, header_bytes = struct.unpack_from("<II", data, 10)
    if header_bytes == 12:
        width, height, _, bits = struct.unpack_from("<HHHH", data, 18)
        compression = 0
    else:
        width, height, _, bits, compression = struct.unpack_from("<iiHHI", data, 18)
    height = abs(height)
    if compression == 0 and len(data) < start + (width * bits + 31) // 32 * 4 * height:
        raise _DamagedError("the image is truncated")
    return ImageHeader(width, height, 1 if bits <= 8 else 3, 8)


_TIFF_FORMATS = {1: "B", 3: "H", 4: "I"}
"""Format for :mod:`struct` of each supported field type."""

_TIFF_TAGS = {
    256: "width",
    257: "height",
    258: "bits",
    273: "strips",
    277: "channels",
    279: "strip bytes",
    322: "tile width",
    323: "tile height",
    324: "tiles",
    325: "tile bytes",
}
"""Tags of the TIFF specification for images in strips and tiles; other tags are skipped."""

_TIFF_MAX_VALUES = 2**20
"""Maximum number of values in a tag; one strip per row of the largest image takes fewer."""

_TIFF_STARTS = (b"II*\x00", b"MM\x00*")
_TIFF_ORIENTATION, _AS_STORED = 274, 1
"""Tag of the orientation (TIFF 6.0), and its value for an image that is shown as it is stored."""


def _tiff_fields(data: bytes) -> Iterator[tuple[str, int, int, int, int]]:
    """Yield byte order, position, tag, type and number of values of every field of the first image."""
    order = "<" if data[:2] == b"II" else ">"
    (start,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, start)
    struct.unpack_from(order + "I", data, start + 2 + 12 * count)  # the link to the next directory must exist
    for place in range(start + 2, start + 2 + 12 * count, 12):
        yield (order, place, *struct.unpack_from(order + "HHI", data, place))


def without_orientation(data: bytes) -> bytes:
    """Return a complete TIFF file without its orientation, which OpenCV would apply; other files are unchanged."""
    turned = bytearray()
    for order, place, tag, kind, _ in _tiff_fields(data) if data.startswith(_TIFF_STARTS) else ():
        layout = order + _TIFF_FORMATS.get(kind, "H")
        if tag == _TIFF_ORIENTATION and struct.unpack_from(layout, data, place + 8) != (_AS_STORED,):
            turned = turned or bytearray(data)
            struct.pack_into(layout, turned, place + 8, _AS_STORED)
    return bytes(turned) or data


def _tiff(data: bytes) -> ImageHeader:
    tags: dict[str, tuple[int, ...]] = {}
    for order, place, tag, kind, number in _tiff_fields(data):
        name = _TIFF_TAGS.get(tag)
        if name is None or name in tags:
            continue
        if kind not in _TIFF_FORMATS or not 0 < number <= _TIFF_MAX_VALUES:
            raise _DamagedError("its TIFF directory is damaged")
        layout = f"{order}{number}{_TIFF_FORMATS[kind]}"
        inline = struct.calcsize(layout) <= 4
        where = place + 8 if inline else struct.unpack_from(order + "I", data, place + 8)[0]
        tags[name] = struct.unpack_from(layout, data, where)
    for places, sizes in (("strips", "strip bytes"), ("tiles", "tile bytes")):
        for offset, length in zip(tags.get(places, ()), tags.get(sizes, ()), strict=False):
            if offset + length > len(data):
                raise _DamagedError("the image is truncated")
    if "width" not in tags or "height" not in tags:
        raise _DamagedError("its TIFF directory states no size")
    width, height = (max(tags[side][0], tags.get(f"tile {side}", (0,))[0]) for side in ("width", "height"))
    return ImageHeader(width, height, tags.get("channels", (1,))[0], max(tags.get("bits", (1,))))


_FORMATS: tuple[tuple[bytes, Callable[[bytes], ImageHeader]], ...] = (
    (PNG_SIGNATURE, _png),
    (b"\xff\xd8\xff", _jpeg),
    (b"P5", _pnm),
    (b"P6", _pnm),
    (b"BM", _bmp),
    *((start, _tiff) for start in _TIFF_STARTS),
)

WITH_METADATA = frozenset({".png", ".jpg", ".jpeg"})
"""Suffixes of files to which metadata can be copied."""

EXIF = b"Exif\0\0"
"""Beginning of an EXIF block."""

_COPIED = (EXIF, b"http://ns.adobe.com/xap/1.0/\0", b"ICC_PROFILE\0")
"""Beginnings of JPEG segments that stay valid in a copy, unlike an index of more pictures in the file."""

_APP1, _APP2, _START_OF_SCAN = 0xE1, 0xE2, 0xDA
"""Markers of JPEG segments: EXIF and XMP, colour profile, and the image itself."""

_LARGEST_SEGMENT = 65533
"""Maximum content of a segment, without the two bytes of its length."""


def with_metadata(image: bytes, original: bytes) -> bytes:
    """Return an encoded image, which has no metadata, with the metadata of its original.

    From JPEG to JPEG, EXIF, XMP and the colour profile are copied; from or to PNG, only EXIF is. Images in other
    formats are returned unchanged. The original is a JPEG or PNG file, or an EXIF block that begins with 'Exif';
    damaged metadata are ignored.
    """
    if image.startswith(JPEG_START) and original.startswith(JPEG_START):
        kept = (_segment(kind, content) for kind, content in _segments(original) if content.startswith(_COPIED))
        return JPEG_START + b"".join(kept) + image[2:]
    exif = original if original.startswith(EXIF) else exif_block(original)
    if not exif:
        return image
    if image.startswith(JPEG_START) and len(exif) <= _LARGEST_SEGMENT:
        return JPEG_START + _segment(_APP1, exif) + image[2:]
    if image.startswith(PNG_SIGNATURE):
        return image[:PNG_HEADER_END] + png_chunk(b"eXIf", exif[len(EXIF) :]) + image[PNG_HEADER_END:]
    return image


def exif_block(data: bytes) -> bytes:
    """Return the EXIF block in a JPEG or PNG file, or in its beginning; empty if there is none."""
    return next((content for _, content in _segments(data) if content.startswith(EXIF)), b"")


def _segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield marker and content of the application segments before the image; the EXIF of a PNG as in a JPEG."""
    with suppress(struct.error, _DamagedError):
        if data.startswith(JPEG_START):
            before = takewhile(lambda segment: segment[0] != _START_OF_SCAN, _jpeg_segments(data))
            yield from ((marker, bytes(content)) for marker, content in before if marker in (_APP1, _APP2))
        elif data.startswith(PNG_SIGNATURE):
            yield from ((_APP1, EXIF + content) for kind, content in _png_chunks(data) if kind == b"eXIf")


def _segment(marker: int, content: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, 2 + len(content)) + content
