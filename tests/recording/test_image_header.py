"""Headers of image files: they are read correctly, and arbitrary bytes do no harm."""

from __future__ import annotations

import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from image_samples import encoded, grey, jpeg_of_size, png_of_size

from ospc.errors import FrameError
from ospc.formats.image_header import ImageHeader, read_header
from ospc.recording.frame import MAX_DECODED_BYTES
from ospc.recording.image_source import decode_grey

SIZE = (37, 23)
COLOUR = np.dstack([grey(seed, SIZE) for seed in range(3)])
WIDE = grey(4, SIZE, np.uint16, 4096)
FILES = {
    "grey PNG": (encoded(grey(0, SIZE)), ImageHeader(37, 23, 1, 8)),
    "colour PNG": (encoded(COLOUR), ImageHeader(37, 23, 3, 8)),
    "16-bit PNG": (encoded(WIDE), ImageHeader(37, 23, 1, 16)),
    "grey JPEG": (encoded(grey(0, SIZE), ".jpg"), ImageHeader(37, 23, 1, 8)),
    "colour JPEG": (encoded(COLOUR, ".jpg"), ImageHeader(37, 23, 3, 8)),
    "PGM": (encoded(grey(0, SIZE), ".pgm"), ImageHeader(37, 23, 1, 8)),
    "16-bit PGM": (encoded(WIDE, ".pgm"), ImageHeader(37, 23, 1, 16)),
    "PPM": (encoded(COLOUR, ".ppm"), ImageHeader(37, 23, 3, 8)),
    "grey BMP": (encoded(grey(0, SIZE), ".bmp"), ImageHeader(37, 23, 1, 8)),
    "colour BMP": (encoded(COLOUR, ".bmp"), ImageHeader(37, 23, 3, 8)),
    "grey TIFF": (encoded(grey(0, SIZE), ".tif"), ImageHeader(37, 23, 1, 8)),
    "16-bit TIFF": (encoded(WIDE, ".tif"), ImageHeader(37, 23, 1, 16)),
}
kinds = st.sampled_from(sorted(FILES))


@pytest.mark.parametrize("kind", FILES)
def test_the_header_states_what_was_written(kind: str) -> None:
    data, header = FILES[kind]
    assert read_header(data, "x") == header


@pytest.mark.parametrize("kind", FILES)
def test_every_truncation_is_an_error(kind: str) -> None:
    data, _ = FILES[kind]
    for length in [*range(min(len(data), 200)), *range(200, len(data), 41), len(data) - 1]:
        with pytest.raises(FrameError, match=r"^picture"):
            decode_grey(data[:length], "picture")


@given(kinds, st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), min_size=1, max_size=8))
def test_changed_bytes_give_an_image_or_an_error(kind: str, changes: list[tuple[int, int]]) -> None:
    data = bytearray(FILES[kind][0])
    for place, value in changes:
        data[place % len(data)] = value
    try:
        image = decode_grey(bytes(data), "picture")
    except FrameError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert image.ndim == 2
        assert image.dtype in (np.uint8, np.uint16)


@given(st.sampled_from([data[:12] for data, _ in FILES.values()]), st.binary(max_size=200))
def test_a_known_beginning_with_anything_after_is_no_crash(start: bytes, rest: bytes) -> None:
    with suppress(FrameError):
        read_header(start + rest, "picture")


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_png_sizes_are_judged_before_decoding(width: int, height: int) -> None:
    if width * height > MAX_DECODED_BYTES:
        with pytest.raises(FrameError, match="bytes allowed"):
            decode_grey(png_of_size(width, height), "picture")


def test_a_thumbnails_end_is_not_the_pictures_end() -> None:
    picture = encoded(grey(0, SIZE), ".jpg")
    thumbnail = b"Exif\0\0" + encoded(grey(1, (8, 8)), ".jpg")
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    data = picture[:2] + segment + picture[2:]
    assert read_header(data, "x") == ImageHeader(37, 23, 1, 8)
    with pytest.raises(FrameError, match="no end marker"):
        read_header(data[:-2], "x")


def test_bytes_after_the_end_of_a_jpeg_do_no_harm() -> None:
    picture = encoded(grey(0, SIZE), ".jpg")
    np.testing.assert_array_equal(decode_grey(picture + bytes(100), "x"), decode_grey(picture, "x"))


def test_runs_of_marker_bytes_and_blanks_take_no_time() -> None:
    for data in (b"\xff\xd8\xff" + b"\xff" * 2_000_000, b"P5" + b" " * 2_000_000, b"P5" + b"#\n" * 1_000_000):
        with pytest.raises(FrameError):
            read_header(data, "x")


@pytest.mark.parametrize("data", [png_of_size(50_000, 50_000), jpeg_of_size(60_000, 60_000)])
def test_absurd_sizes_are_refused(data: bytes) -> None:
    with pytest.raises(FrameError, match="bytes allowed"):
        decode_grey(data, "x")


@pytest.mark.parametrize(
    "data",
    [b"GIF89a", b"%PDF-1.7", b"RIFF0000WEBP", b"v/1\x01", b"\0\0\0\x0cjP  ", b"P2\n1 1\n255\n0", b"Pf\n1 1\n"],
)
def test_other_formats_are_refused_by_content_whatever_their_name(data: bytes) -> None:
    with pytest.raises(FrameError, match="convert it to PNG"):
        read_header(data, "a.png")
