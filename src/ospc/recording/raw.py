"""Raw photographs: the linear values of the sensor, between its black and its white level."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from io import BytesIO
from typing import Any, ClassVar

import numpy as np

from ospc.arrays import Float32Array, Image
from ospc.errors import FrameError, OspcError, SettingError, needs_extra
from ospc.recording.bayer import Mosaic
from ospc.recording.channel import Channel
from ospc.recording.frame import check_decoded_size
from ospc.recording.pixel_layout import BitDepth, StoredImage
from ospc.recording.shot import Shot

_WHITE = 65535
"""Grey value of the white level, at which the sensor saturates."""

_DEPTH = BitDepth(16, 0, 16)
"""Black and white are brought to both ends of 16 bits, which holds the 10 to 14 of sensors."""


class Raw:
    """The format of raw photographs; LibRaw decodes it, by rawpy."""

    suffixes: ClassVar = frozenset({".cr2", ".cr3", ".nef", ".arw", ".dng", ".orf", ".rw2", ".raf", ".pef"})

    def decode(self, data: bytes, name: str, channel: Channel | None) -> StoredImage:
        """Decode to linear values of 16 bits, black at 0 and white at 65535.

        A Bayer mosaic stays one; in colour, each of its 2×2 blocks becomes a pixel, without interpolation and without
        white balance.
        """
        with _opened(data, name) as photo:
            colours = photo.color_desc.decode("ascii", "replace").lower()
            sizes, stacked = photo.sizes, photo.raw_type.name == "Stack"
            check_decoded_size((sizes.raw_width, sizes.raw_height), 4 if stacked else 1, 16, name)
            black, white = np.array(photo.black_level_per_channel, np.float32), float(photo.white_level)
            if white <= black.max():
                raise FrameError(f"{name}: states a white level of {white:g} below its black level; leave it out")
            pixels = photo.raw_image_visible
            if stacked:
                linear = _scaled(pixels[:, :, :3], black[:3], white)
                return StoredImage((channel or Channel.LUMINANCE).of(linear[:, :, ::-1]), colour=True, depth=_DEPTH)
            if photo.num_colors == 1:
                return StoredImage(_scaled(pixels, black[0], white), depth=_DEPTH)
            block = photo.raw_colors_visible[:2, :2]
            mosaic = _mosaic(photo, "".join(colours[i] for i in block.ravel()), name)
            linear = np.empty_like(pixels)
            for row, column in np.ndindex(2, 2):
                part = pixels[row::2, column::2]
                linear[row::2, column::2] = _scaled(part, black[block[row, column]], white)
            if channel is Channel.ALL:
                return StoredImage(mosaic.of(linear, channel), colour=True, depth=_DEPTH)
            return StoredImage(linear, mosaic=mosaic, depth=_DEPTH)

    def shot(self, data: bytes, name: str) -> Shot:
        """Return how LibRaw says that it was taken."""
        with _opened(data, name) as photo:
            stated = photo.other
            numbers = (stated.shutter_speed, stated.iso_speed, stated.aperture)
            time_s, iso, f_number = (float(n) if np.isfinite(n) and n > 0 else None for n in numbers)
            taken = stated.timestamp if stated.timestamp > datetime(1971, 1, 1) else None
            return Shot(time_s, iso, f_number, taken)

    def exif(self, data: bytes) -> bytes:
        """Return nothing: the EXIF of a raw file describes its own pixels, and leads all over it."""
        return b""


@contextmanager
def _opened(data: bytes, name: str) -> Iterator[Any]:
    with needs_extra("reading raw photographs", "raw"):
        import rawpy
    try:
        with rawpy.imread(BytesIO(data)) as photo:
            yield photo
    except OspcError:
        raise
    except Exception as error:
        # LibRaw's own errors, and those of types that rawpy has no class for.
        raise FrameError(f"{name}: is damaged, or of an unknown camera; convert it to 16-bit TIFF") from error


def _mosaic(photo: Any, pattern: str, name: str) -> Mosaic:
    try:
        return Mosaic(pattern if np.shape(photo.raw_pattern) == (2, 2) else "")
    except SettingError:
        raise FrameError(
            f"{name}: its colours are not arranged as in a Bayer mosaic; convert it to 16-bit TIFF without a curve"
        ) from None


def _scaled(pixels: Image, black: Float32Array, white: float) -> Image:
    """Bring black to 0 and white to 65535; noise below black is cut off."""
    scaled = (pixels - black) * (_WHITE / (white - black))
    return np.rint(np.clip(scaled, 0, _WHITE, out=scaled), out=scaled).astype(np.uint16)


RAW = Raw()
