"""A photograph's metadata survives changes to its pixels; damaged metadata does no harm."""

from __future__ import annotations

from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image

from ospc.formats.image_header import with_metadata

PIXELS = np.full((8, 8), 100, np.uint8)


def original(kind, **metadata):
    exif = Image.Exif()
    exif[0x010F] = "Acme"
    file = BytesIO()
    Image.fromarray(PIXELS).save(file, kind, exif=exif, **metadata)
    return file.getvalue()


def encoded(suffix, image=PIXELS):
    return cv2.imencode(suffix, image)[1].tobytes()


@pytest.mark.parametrize("before", ["JPEG", "PNG"])
@pytest.mark.parametrize("image", [encoded(".jpg"), encoded(".png"), encoded(".png", PIXELS.astype(np.uint16))])
def test_exif_is_kept_between_jpeg_and_png(before, image):
    result = with_metadata(image, original(before))
    with Image.open(BytesIO(result)) as opened:
        assert opened.getexif()[0x010F] == "Acme"
    np.testing.assert_array_equal(
        cv2.imdecode(np.frombuffer(result, np.uint8), cv2.IMREAD_UNCHANGED),
        cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_UNCHANGED),
    )


def test_jpeg_keeps_its_colour_profile_and_xmp_but_no_index_of_other_pictures():
    jpeg = original("JPEG", icc_profile=b"profile", xmp=b"<x/>")
    index = b"\xff\xe2\x00\x08MPF\0ab"
    result = with_metadata(encoded(".jpg"), jpeg[:2] + index + jpeg[2:])
    with Image.open(BytesIO(result)) as opened:
        assert opened.info["icc_profile"] == b"profile"
        assert opened.info["xmp"] == b"<x/>"
    assert b"MPF" not in result


@pytest.mark.parametrize("image", [encoded(".jpg"), encoded(".png"), encoded(".tiff")])
@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
def test_damaged_and_missing_metadata_count_as_none(image, kind):
    whole = original(kind)
    assert with_metadata(image, b"") == image
    assert with_metadata(encoded(".tiff"), whole) == encoded(".tiff")
    for end in range(0, len(whole), 7):
        result = with_metadata(image, whole[:end])
        assert cv2.imdecode(np.frombuffer(result, np.uint8), cv2.IMREAD_UNCHANGED) is not None
