"""Image formats decoded by optional libraries, HEIC and raw, and the EXIF of photographs."""

from __future__ import annotations

import math
import re
import warnings
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from io import BytesIO
from pathlib import PurePath
from typing import Any, ClassVar, Protocol

import numpy as np

from ospc.arrays import Float32Array, Image
from ospc.errors import FrameError, OspcError, needs_extra
from ospc.formats.image_header import EXIF
from ospc.recording.channel import Channel, Mosaic
from ospc.recording.frame import check_decoded_size
from ospc.recording.pixel_layout import BitDepth, StoredImage

_MOST_BYTES = 8 * 2**20
"""Maximum number of EXIF bytes read from a photograph, counting repeated reads: far more than cameras write."""

_READ_COST_BYTES, _MISSED_COST_BYTES = 512, 65536
"""Minimum cost of a read, which also limits the number of reads, and cost of a read beyond the end: damaged
directories have thousands of entries there, truncated files a few."""


@dataclass(frozen=True)
class Shot:
    """How a photograph was taken. Values missing in the file are None, or "" for the camera model."""

    time_s: float | None = None
    iso: float | None = None
    f_number: float | None = None
    taken: datetime | None = None
    model: str = ""
    focal_mm: float | None = None


def shot_of_exif(block: bytes) -> Shot:
    """Read an EXIF block, which has the form of a TIFF file; a damaged one gives an empty result."""
    from PIL import Image as Pillow
    from PIL.ExifTags import IFD, Base

    exif = Pillow.Exif()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about unusual files
            exif.load_from_fp(_BoundedReads(block.removeprefix(EXIF)))
            tags = exif.get_ifd(IFD.Exif)
            model = str(exif.get(Base.Model, ""))
    except Exception:
        # The parser raises undocumented errors for damaged EXIF.
        return Shot()
    numbers = (Base.ExposureTime, Base.ISOSpeedRatings, Base.FNumber, Base.FocalLength)
    time_s, iso, f_number, focal_mm = (_positive(tags.get(tag)) for tag in numbers)
    taken = _taken(tags.get(Base.DateTimeOriginal), tags.get(Base.SubsecTimeOriginal, "0"))
    return Shot(time_s, iso, f_number, taken, model, focal_mm)


class _BoundedReads(BytesIO):
    """Raises an error after too many reads: overlapping directories in hostile EXIF would take hours."""

    _left = _MOST_BYTES

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size)
        self._left -= max(len(found), _READ_COST_BYTES if found else _MISSED_COST_BYTES)
        if self._left < 0:
            raise ValueError("too many reads")
        return found


def _positive(value: Any) -> float | None:
    """Return the number in a tag, the first of several; None if it is missing or not positive."""
    try:
        number = float(value[0] if isinstance(value, tuple) else value)
    except (IndexError, TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if math.isfinite(number) and number > 0 else None


def _taken(date_and_time: object, fraction: object) -> datetime | None:
    digits = str(fraction).strip()[:6]
    decimals = digits if digits.isascii() and digits.isdigit() else "0"
    try:
        return datetime.strptime(f"{date_and_time}.{decimals}", "%Y:%m:%d %H:%M:%S.%f")
    except ValueError:
        return None


_TURNS = re.compile(rb"\0\0\0\x09(irot|imir)(.)", re.DOTALL)
"""Properties that rotate or mirror an image for display (ISO/IEC 23008-12, 6.5.10 and 6.5.12)."""


class ImageFormat(Protocol):
    """Decodes the files of a format; all methods raise MissingExtraError if its library is not installed."""

    suffixes: ClassVar[frozenset[str]]
    """Suffixes of its files, in lower case."""

    @abstractmethod
    def decode(self, data: bytes, name: str, channel: Channel | None) -> StoredImage:
        """Decode a file, called ``name`` in messages, to a channel; FrameError if that fails."""

    @abstractmethod
    def shot(self, data: bytes, name: str) -> Shot:
        """Return how a photograph was taken; FrameError if the file is damaged."""

    def exif(self, data: bytes) -> bytes:
        """Return the EXIF block for a corrected copy, beginning with the marker 'Exif'; empty if there is none."""
        return b""


class Heic(ImageFormat):
    """HEIC photographs, decoded by pillow-heif."""

    suffixes = frozenset({".heic", ".heif", ".hif"})

    def decode(self, data: bytes, name: str, channel: Channel | None) -> StoredImage:
        """Decode to a channel, by default green; more than 8 bits are right-aligned in 16."""
        photo = self._opened(data, name)
        check_decoded_size(photo.size, len(photo.mode.partition(";")[0]), 16 if ";" in photo.mode else 8, name)
        try:
            pixels = np.asarray(photo)
        except Exception as error:
            raise self._damaged(name) from error
        depth = None
        if pixels.dtype == np.uint16:  # decoded left-aligned; dark images would not show how many bits there are
            depth = BitDepth(int(photo.info["bit_depth"]), 0, 16)
            pixels = pixels >> (16 - depth.bits)
        if pixels.ndim == 3:  # drop transparency
            pixels = pixels[:, :, :3] if pixels.shape[2] >= 3 else pixels[:, :, 0]
        # libheif rotates the image for display, but response and vignette refer to the axes of the sensor.
        for kind, (value,) in reversed(_TURNS.findall(data)[:2]):
            pixels = np.rot90(pixels, -value) if kind == b"irot" else np.flip(pixels, value & 1)
        return StoredImage.of(pixels, channel, depth)

    def shot(self, data: bytes, name: str) -> Shot:
        """Return how the photograph was taken, from its EXIF."""
        return shot_of_exif(self._exif(data, name))

    def exif(self, data: bytes) -> bytes:
        """Return the EXIF block."""
        try:
            return self._exif(data, "")
        except FrameError:
            return b""

    def _exif(self, data: bytes, name: str) -> bytes:
        block: bytes = self._opened(data, name).info.get("exif") or b""
        return EXIF + block.removeprefix(EXIF) if block else b""

    def _opened(self, data: bytes, name: str) -> Any:
        """Return the main image of a file, not yet decoded."""
        with needs_extra("reading HEIC photographs", "heic"):
            import pillow_heif
        try:
            file = pillow_heif.open_heif(BytesIO(data), convert_hdr_to_8bit=False, bgr_mode=True)
            return file[file.primary_index]
        except Exception as error:
            # libheif and its EXIF parser raise many types of errors.
            raise self._damaged(name) from error

    def _damaged(self, name: str) -> FrameError:
        return FrameError(f"{name}: the HEIC image is damaged and cannot be decoded; copy or download it again")


_WHITE = 65535
"""Grey value of the white level, at which the sensor saturates."""

_DEPTH = BitDepth(16, 0, 16)
"""Black and white are scaled to the full range of 16 bits, more than the 10 to 14 bits of sensors."""


class Raw(ImageFormat):
    """Raw photographs, decoded by LibRaw through rawpy.

    Corrected copies get no EXIF: the EXIF of a raw file describes its own pixels and is scattered over the file.
    """

    suffixes = frozenset({".cr2", ".cr3", ".nef", ".arw", ".dng", ".orf", ".rw2", ".raf", ".pef"})

    def decode(self, data: bytes, name: str, channel: Channel | None) -> StoredImage:
        """Decode to linear 16-bit values with black at 0 and white at 65535; a Bayer mosaic is not interpolated.

        In colour, each of its 2×2 blocks becomes a pixel, without white balance.
        """
        with _opened_raw(data, name) as photo:
            colours = photo.color_desc.decode("ascii", "replace").lower()
            sizes, stacked = photo.sizes, photo.raw_type.name == "Stack"
            check_decoded_size((sizes.raw_width, sizes.raw_height), 4 if stacked else 1, 16, name)
            black, white = np.array(photo.black_level_per_channel, np.float32), float(photo.white_level)
            if white <= black.max():
                raise FrameError(f"{name}: its white level of {white:g} is below its black level; remove the file")
            pixels = photo.raw_image_visible
            if stacked:
                linear = _scaled(pixels[:, :, :3], black[:3], white)
                return StoredImage.of(linear[:, :, ::-1], channel, _DEPTH)
            if photo.num_colors == 1:
                return StoredImage(_scaled(pixels, black[0], white), depth=_DEPTH)
            block = photo.raw_colors_visible[:2, :2]
            pattern = "".join(colours[i] for i in block.ravel())
            if np.shape(photo.raw_pattern) != (2, 2) or pattern not in Mosaic.PATTERNS + Mosaic.GREEN_PATTERNS:
                raise FrameError(
                    f"{name}: its colours are not arranged as in a Bayer mosaic; convert it to linear 16-bit TIFF"
                )
            mosaic = Mosaic(pattern)
            linear = np.empty_like(pixels)
            for row, column in np.ndindex(2, 2):
                part = pixels[row::2, column::2]
                linear[row::2, column::2] = _scaled(part, black[block[row, column]], white)
            if channel is Channel.ALL:
                return StoredImage(mosaic.of(linear, channel), channel, depth=_DEPTH)
            return StoredImage(linear, mosaic=mosaic, depth=_DEPTH)

    def shot(self, data: bytes, name: str) -> Shot:
        """Return how the photograph was taken, as read by LibRaw."""
        with _opened_raw(data, name) as photo:
            stated = photo.other
            numbers = (stated.shutter_speed, stated.iso_speed, stated.aperture)
            time_s, iso, f_number = (float(n) if np.isfinite(n) and n > 0 else None for n in numbers)
            taken = stated.timestamp if stated.timestamp > datetime(1971, 1, 1) else None
            return Shot(time_s, iso, f_number, taken)


@contextmanager
def _opened_raw(data: bytes, name: str) -> Iterator[Any]:
    with needs_extra("reading raw photographs", "raw"):
        import rawpy
    try:
        with rawpy.imread(BytesIO(data)) as photo:
            yield photo
    except OspcError:
        raise
    except Exception as error:
        # LibRaw's own errors, and others that rawpy does not wrap.
        raise FrameError(f"{name}: is damaged, or from an unknown camera; convert it to 16-bit TIFF") from error


def _scaled(pixels: Image, black: Float32Array, white: float) -> Image:
    """Scale black to 0 and white to 65535; noise below black is clipped."""
    scaled = (pixels - black) * (_WHITE / (white - black))
    return np.rint(np.clip(scaled, 0, _WHITE, out=scaled), out=scaled).astype(np.uint16)


_FORMATS: tuple[ImageFormat, ...] = (Heic(), Raw())


def format_of(name: str | PurePath) -> ImageFormat | None:
    """Return the format of a file name that needs an optional library; None for all other files."""
    suffix = PurePath(name).suffix.lower()
    return next((known for known in _FORMATS if suffix in known.suffixes), None)
