"""HEIC photographs, as phones take them."""

from __future__ import annotations

import re
from io import BytesIO
from typing import Any, ClassVar

import numpy as np

from ospc.arrays import Image
from ospc.errors import FrameError, needs_extra
from ospc.recording.channel import Channel
from ospc.recording.frame import check_decoded_size
from ospc.recording.pixel_layout import StoredImage
from ospc.recording.shot import Shot, shot_of_exif

_TURNS = re.compile(rb"\0\0\0\x09(irot|imir)(.)", re.DOTALL)
"""Properties of an image by which it is turned and mirrored for display (ISO/IEC 23008-12, 6.5.10 and 6.5.12)."""

_EXIF = b"Exif\0\0"


class Heic:
    """The format of HEIC photographs; pillow-heif decodes it."""

    suffixes: ClassVar = frozenset({".heic", ".heif", ".hif"})

    def decode(self, data: bytes, name: str, channel: Channel | None) -> StoredImage:
        """Decode to one channel, by default to luma; more than 8 bits are left-aligned in 16."""
        photo = _opened(data, name)
        check_decoded_size(photo.size, len(photo.mode.partition(";")[0]), 16 if ";" in photo.mode else 8, name)
        try:
            pixels = np.asarray(photo)
        except Exception as error:
            raise _damaged(name) from error
        colour = pixels.ndim == 3 and pixels.shape[2] >= 3
        if pixels.ndim == 3:  # without transparency
            pixels = np.ascontiguousarray(pixels[:, :, :3]) if colour else pixels[:, :, 0]
        if colour:
            pixels = (channel or Channel.LUMINANCE).of(pixels)
        return StoredImage(_on_sensor(pixels, data), colour)

    def shot(self, data: bytes, name: str) -> Shot:
        """Return what its EXIF says."""
        return shot_of_exif(_exif_of(_opened(data, name)).removeprefix(_EXIF))

    def exif(self, data: bytes) -> bytes:
        """Return the EXIF block."""
        try:
            return _exif_of(_opened(data, ""))
        except FrameError:
            return b""


def _opened(data: bytes, name: str) -> Any:
    """Read everything but the pixels, of the main image if there are several."""
    with needs_extra("reading HEIC photographs", "heic"):
        import pillow_heif
    try:
        file = pillow_heif.open_heif(BytesIO(data), convert_hdr_to_8bit=False, bgr_mode=True)
        return file[file.primary_index]
    except Exception as error:
        # libheif's errors, and those of the EXIF inside, are of many types.
        raise _damaged(name) from error


def _exif_of(photo: Any) -> bytes:
    block: bytes = photo.info.get("exif") or b""
    return _EXIF + block.removeprefix(_EXIF) if block else b""


def _damaged(name: str) -> FrameError:
    return FrameError(f"{name}: the HEIC image is damaged and cannot be decoded; copy or download it again")


def _on_sensor(pixels: Image, data: bytes) -> Image:
    """Undo how libheif turned an image for display: response and vignette belong to the axes of the sensor."""
    for kind, (value,) in reversed(_TURNS.findall(data)[:2]):
        if kind == b"irot":
            pixels = np.rot90(pixels, -value)
        elif kind == b"imir":
            pixels = np.flip(pixels, value & 1)
    return np.ascontiguousarray(pixels)


HEIC = Heic()
