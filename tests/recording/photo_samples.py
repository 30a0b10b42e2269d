"""Sample HEIC and raw photographs."""

from __future__ import annotations

import struct
from io import BytesIO

import numpy as np

from exif_segments import directory, exif
from ospc.arrays import Image

_PHOTOMETRIC = {1: 32803, 3: 34892}
"""PhotometricInterpretation in the DNG specification by number of channels: a mosaic, or linear colours."""


def heic(image: Image, segment: bytes = b"", orientation: int = 1, quality: int = 100) -> bytes:
    """Return a HEIC file of an image, (height, width) or (height, width, 3) in blue, green, red; uint8 or uint16."""
    import pillow_heif

    mode = ("BGR" if image.ndim == 3 else "L") + (";16" if image.dtype == np.uint16 else "")
    photo = pillow_heif.from_bytes(mode, image.shape[1::-1], np.ascontiguousarray(image).tobytes())
    file = BytesIO()
    block = segment[4:] or (exif(orientation=orientation)[4:] if orientation != 1 else None)
    photo.save(file, quality=quality, chroma=444, exif=block)
    return file.getvalue()


def dng(
    pixels: Image,
    black: tuple[int, int, int, int] | int = 64,
    white: int = 1023,
    pattern: str = "rggb",
    time: tuple[int, int] = (1, 100),
    iso: int = 100,
    taken: str = "2020:01:02 03:04:05",
) -> bytes:
    """Return a DNG file of a mosaic, (height, width), or of colours, (height, width, 3) in red, green, blue."""
    samples = 1 if pixels.ndim == 2 else 3

    def shorts(*values: int) -> tuple[int, int, bytes]:
        return 3, len(values), struct.pack(f"<{len(values)}H", *values)

    def long(value: int) -> tuple[int, int, bytes]:
        return 4, 1, struct.pack("<I", value)

    def text(value: str) -> tuple[int, int, bytes]:
        return 2, len(value) + 1, value.encode() + b"\0"

    levels = (black,) * samples if isinstance(black, int) else black
    cells = (1, 1) if isinstance(black, int) else (2, 2)
    identity = struct.pack("<18i", *(int(v) for i in range(9) for v in (i % 4 == 0, 1)))
    shot = [
        (0x829A, 5, 1, struct.pack("<II", *time)),
        (0x829D, 5, 1, struct.pack("<II", 4, 1)),
        (0x8827, *shorts(iso)),
        (0x9003, *text(taken)),
    ]
    main = {
        254: long(0),
        256: long(pixels.shape[1]),
        257: long(pixels.shape[0]),
        258: shorts(*[16] * samples),
        259: shorts(1),
        262: shorts(_PHOTOMETRIC[samples]),
        271: text("Maker"),
        272: text("Model"),
        273: long(0),
        277: shorts(samples),
        278: long(pixels.shape[0]),
        279: long(pixels.nbytes),
        306: text(taken),
        **({33421: shorts(2, 2), 33422: (1, 4, bytes("rgb".index(c) for c in pattern))} if samples == 1 else {}),
        34665: long(0),
        50706: (1, 4, b"\1\4\0\0"),
        50708: text("Maker Model"),
        50713: shorts(*cells),
        50714: shorts(*levels),
        50717: shorts(*[white] * samples),
        50721: (10, 9, identity),
        50728: (5, 3, struct.pack("<6I", *[1] * 6)),
    }

    def packed() -> bytes:
        return directory([(tag, *value) for tag, value in main.items()], 8)

    inner = 8 + len(packed())
    start = inner + len(directory(shot, inner))
    main[273], main[34665] = long(start), long(inner)
    return b"II*\0" + struct.pack("<I", 8) + packed() + directory(shot, inner) + pixels.astype("<u2").tobytes()
