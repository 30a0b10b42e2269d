"""EXIF metadata of photographs, as segments of JPEG files."""

from __future__ import annotations

import struct

Fraction = tuple[int, int]


def exif(
    time: Fraction | None = (1, 100),
    f_number: Fraction | None = (8, 1),
    iso: int | None = 100,
    taken: str | None = "2020:01:02 03:04:05",
    model: str = "M1",
    orientation: int | None = None,
    focal_mm: int | None = None,
) -> bytes:
    """Return a JPEG segment with the given EXIF fields."""
    entries: list[tuple[int, int, int, bytes]] = []
    if time is not None:
        entries.append((0x829A, 5, 1, struct.pack("<II", *time)))
    if f_number is not None:
        entries.append((0x829D, 5, 1, struct.pack("<II", *f_number)))
    if iso is not None:
        entries.append((0x8827, 3, 1, struct.pack("<HH", iso, 0)))
    if taken is not None:
        entries.append((0x9003, 2, len(taken) + 1, taken.encode() + b"\0"))
    if focal_mm is not None:
        entries.append((0x920A, 5, 1, struct.pack("<II", focal_mm, 1)))
    camera = (0x110, 2, len(model) + 1, model.encode() + b"\0")
    first = [camera]
    if orientation is not None:
        first.append((0x112, 3, 1, struct.pack("<HH", orientation, 0)))
    inner = 8 + len(directory([*first, (0x8769, 4, 1, b"")], 8))
    main = directory([*first, (0x8769, 4, 1, struct.pack("<I", inner))], 8)
    body = b"Exif\0\0II*\0" + struct.pack("<I", 8) + main + directory(entries, inner)
    return b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body


def directory(entries: list[tuple[int, int, int, bytes]], start: int) -> bytes:
    """Return a TIFF directory at the given offset, followed by its longer values."""
    place = start + 2 + 12 * len(entries) + 4
    rows, values = b"", b""
    for tag, kind, count, value in entries:
        stored = value.ljust(4, b"\0")
        if len(value) > 4:
            stored = struct.pack("<I", place + len(values))
            values += value
        rows += struct.pack("<HHI", tag, kind, count) + stored
    return struct.pack("<H", len(entries)) + rows + bytes(4) + values
