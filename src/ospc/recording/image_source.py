"""Image files of a recording, in a folder or in a zip archive, and their decoding. Archives are never extracted."""

from __future__ import annotations

import os
import re
import stat
import threading
import zipfile
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path, PurePosixPath

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import FrameError, RecordingError, escaped, listed, os_error_as, quoted
from ospc.formats.files import by_name, read_bytes
from ospc.formats.image_header import JPEG_START, PNG_SIGNATURE, ImageHeader, read_header, without_orientation
from ospc.recording.channel import DEFAULT_CHANNEL, Channel
from ospc.recording.frame import check_decoded_size
from ospc.recording.image_formats import format_of
from ospc.recording.pixel_layout import StoredImage

# The EXIF orientation is ignored: response and vignette refer to the axes of the sensor.
_STORED = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_GREY, _COLOUR = cv2.IMREAD_GRAYSCALE | _STORED, cv2.IMREAD_COLOR | _STORED
_DEFLATE_EXPANDS = 1032
"""Largest compression ratio of PNG: deflate needs at least two bits to copy 258 bytes."""


def decode_grey(data: bytes, name: str) -> Image:
    """Decode an image file with :func:`decode_stored`; colour becomes luma, 0.299 R + 0.587 G + 0.114 B."""
    return decode_stored(data, name, Channel.LUMINANCE).pixels


def decode_stored(data: bytes, name: str, channel: Channel | None = None) -> StoredImage:
    """Decode the content of an image file, called ``name`` in messages, to a channel, by default green.

    HEIC and raw photographs are recognised by name, all others by content.

    Raises
    ------
    FrameError
        If it is not an image, is truncated, damaged or too large, or does not have 8 or 16 bits.
    """
    optional = format_of(name)
    if optional is not None:
        return optional.decode(data, name, channel)
    header = read_header(data, name)
    check_decoded_size((header.width, header.height), header.channels, header.bits, name)
    damaged = FrameError(f"{name}: the image is damaged and cannot be decoded; copy or download it again")
    if not _can_hold(data, header):
        raise damaged
    colour = header.channels > 2
    wanted = channel or DEFAULT_CHANNEL
    # JPEG stores luma. For other formats, decoders truncate in the conversion to grey, while OpenCV rounds.
    in_colour = colour and not (data.startswith(JPEG_START) and wanted is Channel.LUMINANCE)
    stored = np.frombuffer(without_orientation(data), dtype=np.uint8)
    try:
        image: Image | None = cv2.imdecode(stored, _COLOUR if in_colour else _GREY)
        if in_colour and image is not None and image.ndim == 3:
            image = wanted.of(image)
    except (cv2.error, MemoryError):
        image = None
    if image is None:
        raise damaged
    if image.dtype not in (np.uint8, np.uint16):
        raise FrameError(
            f"{name}: has {image.dtype} values; convert it to PNG with 8 or 16 bits, the output of 'ospc correct "
            "--output grey16'"
        )
    return StoredImage(image, wanted if colour else None)


def _can_hold(data: bytes, header: ImageHeader) -> bool:
    """Return whether a file is large enough for the pixels in its header; otherwise decoding it would take long."""
    pixels = header.width * header.height
    if data.startswith(JPEG_START):
        # Each block of 8×8 pixels takes at least one bit, for its mean.
        return pixels // 64 <= 8 * len(data)
    if data.startswith(PNG_SIGNATURE):
        return pixels * header.bits // 8 <= _DEFLATE_EXPANDS * len(data)
    return True


_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm"})
"""Suffixes of image files that need no optional library, in lower case."""

MAX_FILE_BYTES = 256 * 2**20
"""Maximum size of an image file."""

MAX_MEMBERS, MAX_EXPANSION, FREE_EXPANSION_BYTES = 1_000_000, 200, 16 * 2**20
"""Maximum number of members of a zip archive, and maximum expansion of a member: photographs hardly compress. Members
up to the last size may expand more, because black images do."""


def is_image_name(name: str) -> bool:
    """Return whether a file name has the suffix of an image and is not hidden."""
    known = PurePosixPath(name).suffix.lower() in _SUFFIXES or format_of(name) is not None
    return known and not name.startswith(".")


@dataclass(frozen=True)
class ImageSource(ABC):
    """Image files in a folder or archive; names are sorted with numbers in numeric order.

    ``left_out`` are files in other formats, usually the same photographs as HEIC or raw files next to JPEGs.
    """

    place: Path
    names: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    @abstractmethod
    def read(self, name: str) -> bytes:
        """Return the bytes of an image file.

        Raises
        ------
        FrameError
            If it cannot be read.
        RecordingError
            If no more files can be read.
        """

    def label(self, name: str) -> str:
        """Return the path of an image file for messages."""
        return escaped(str(self.place / name))

    def decoded(self, name: str, channel: Channel | None) -> StoredImage:
        """Read and decode an image file, with the errors of both."""
        return decode_stored(self.read(name), self.label(name), channel)


@dataclass(frozen=True)
class FolderImages(ImageSource):
    """The image files of a folder, without subfolders."""

    @classmethod
    def of(cls, folder: Path) -> FolderImages:
        """List a folder; RecordingError if that fails."""
        with os_error_as(RecordingError, f"{folder}: cannot be listed", "give a folder, and check its permissions"):
            # is_file() excludes pipes and devices, which could block forever.
            names = [p.name for p in folder.iterdir() if is_image_name(p.name) and p.is_file()]
        names.sort(key=by_name)
        # Use images that need no optional library if there are any, otherwise those in the format of the first one.
        formats = [format_of(name) for name in names]
        read = None if None in formats else next(iter(formats), None)
        used = tuple(name for name, found in zip(names, formats, strict=True) if found is read)
        left_out = tuple(name for name, found in zip(names, formats, strict=True) if found is not read)
        return cls(folder, used, left_out)

    def read(self, name: str) -> bytes:
        """Return the bytes of an image file; FrameError if it cannot be read or is too large."""
        try:
            return read_bytes(self.place / name, MAX_FILE_BYTES, FrameError)
        except FrameError:
            if self.place.is_dir():
                raise
        # The folder is gone, for example with its disk; this must not count as unreadable frames.
        raise RecordingError(f"{self.place}: was removed while it was read; restore it and run the command again")


@dataclass(frozen=True)
class ZipImages(ImageSource):
    """The image files of a zip archive; thread-safe."""

    _archive: zipfile.ZipFile = field(repr=False, compare=False, kw_only=True)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False, kw_only=True)

    @classmethod
    def of(cls, path: Path) -> ZipImages:
        """Open an archive; RecordingError if it is not a zip archive, is damaged, or has suspicious members."""
        try:
            archive = zipfile.ZipFile(path)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror}); check the file") from None
        except Exception:
            # zipfile raises undocumented errors for damaged archives.
            raise RecordingError(f"{path}: not a zip archive, or damaged; copy or download it again") from None
        names = _checked_members(archive.infolist(), path)
        return cls(path, tuple(sorted(names, key=by_name)), _archive=archive)

    def read(self, name: str) -> bytes:
        """Return the bytes of a member; FrameError if it is damaged."""
        size = self._archive.getinfo(name).file_size
        try:
            # The length limits decompression.
            with self._lock, self._archive.open(name) as member:
                data = member.read(size + 1)
        except Exception:
            raise FrameError(
                f"{self.label(name)}: cannot be read from the archive; copy or download it again"
            ) from None
        if len(data) != size:
            raise FrameError(f"{self.label(name)}: ends early; copy or download the archive again")
        return data


def _checked_members(members: list[zipfile.ZipInfo], path: Path) -> list[str]:
    """Return the names of the images; RecordingError if a member is hostile or ambiguous."""
    if len(members) > MAX_MEMBERS:
        raise RecordingError(f"{path}: has more than the {MAX_MEMBERS} members allowed; split the archive")
    images: dict[str, zipfile.ZipInfo] = {}
    for member in members:
        parts = re.split(r"[/\\]", member.filename)
        # Archives from macOS contain a hidden companion of every file.
        if not is_image_name(parts[-1]) or "__MACOSX" in parts:
            continue
        problem = "appears twice" if member.filename in images else _problem(member)
        if problem:
            raise RecordingError(f"{path}: member {quoted(member.filename)} {problem}; create the archive again")
        images[member.filename] = member
    folders = sorted({str(PurePosixPath(name).parent) for name in images})
    if len(folders) > 1:
        two = f"{quoted(folders[0])} and {quoted(folders[1])}"
        raise RecordingError(f"{path}: has images in the folders {two}; keep those of one camera")
    return list(images)


def _problem(member: zipfile.ZipInfo) -> str | None:
    """Return what is wrong with a member, or None."""
    name = member.filename
    problems = {
        "has a path that leads out of the archive": (
            name.startswith("/") or "\\" in name or ":" in name or ".." in name.split("/")
        ),
        "is a link": stat.S_ISLNK(member.external_attr >> 16),
        "is encrypted": bool(member.flag_bits & 1),
        "has an unsupported compression": member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED),
        f"has more than the {MAX_FILE_BYTES} bytes allowed": member.file_size > MAX_FILE_BYTES,
        f"expands to more than {MAX_EXPANSION} times its size": (
            member.file_size > max(FREE_EXPANSION_BYTES, MAX_EXPANSION * member.compress_size)
        ),
    }
    return next((problem for problem, found in problems.items() if found), None)


_MOST_FOLDERS = 1000
"""Maximum number of folders searched for images; data sets have fewer above their images."""

_UNREAD = frozenset({".webp", ".avif", ".jxl", ".jp2", ".exr", ".gif"})
"""Suffixes of images that are not read."""


def why_unread(place: Path) -> str | None:
    """Return why no images are found at an existing path, with a remedy; None if nothing there looks like images.

    Raises
    ------
    FrameError
        If the path is a file that has the name of an image but cannot be decoded.
    """
    if place.is_file() and is_image_name(place.name):
        FolderImages(place.parent, (place.name,)).decoded(place.name, None)
        return "is a single image, but a recording has many; give the folder of the images"
    for path in place.iterdir() if place.is_dir() else (place,):
        if path.suffix.lower() in _UNREAD:
            formats = "WebP, AVIF, JPEG XL, JPEG 2000, EXR and GIF"
            return f"images such as {escaped(path.name)} are not supported ({formats}); convert them to PNG"
    inner = _folders_with_images(place)
    if not inner:
        return None
    # A recording is the folder above images/, which may also have the list of exposures.
    within = [path.relative_to(place) for path in inner]
    names = listed([path.parent if path.name == "images" and len(path.parts) > 1 else path for path in within])
    return f"has images only in subfolders; give one of them: {names}"


def _folders_with_images(place: Path) -> list[Path]:
    """Return the folders below a path that contain images, nearest first."""
    walked = islice(os.walk(place), _MOST_FOLDERS)
    found = [Path(folder) for folder, _, files in walked if any(map(is_image_name, files))]
    return sorted(found, key=lambda folder: (len(folder.parts), by_name(str(folder))))
