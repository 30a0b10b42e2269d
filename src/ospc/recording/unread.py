"""Why a path holds no images that can be read, and what to do about it."""

from __future__ import annotations

from collections import deque
from pathlib import Path

from ospc.errors import escaped, listed
from ospc.recording.decoding import decode_grey
from ospc.recording.image_source import FolderImages, is_image_name

_MOST_FOLDERS = 1000
"""Folders searched for images; data sets have fewer above their images."""

_UNREAD = frozenset({".webp", ".avif", ".jxl", ".jp2", ".exr", ".gif"})
"""Suffixes of images that are not read."""


def why_unread(place: Path) -> str | None:
    """Return why no images are found at an existing path, with a remedy; None if nothing there looks like images.

    Raises FrameError if it is a file that is called like an image but cannot be decoded.
    """
    if place.is_file():
        if is_image_name(place.name):
            decode_grey(FolderImages(place.parent, (place.name,)).read(place.name), str(place))
            return "is a single image, and a recording is many; name the folder that holds them"
        return _conversion(place)
    if not place.is_dir():
        return None
    for path in place.iterdir():
        reason = _conversion(path)
        if reason is not None:
            return reason
    inner = _folders_with_images(place)
    if not inner:
        return None
    names = listed([path.relative_to(place) for path in inner])
    return f"holds no images itself; name one of the folders in it that do: {names}"


def _conversion(path: Path) -> str | None:
    if path.suffix.lower() not in _UNREAD:
        return None
    formats = "WebP, AVIF, JPEG XL, JPEG 2000, EXR and GIF"
    return f"images such as {escaped(path.name)} are not read ({formats}); convert them to PNG"


def _folders_with_images(place: Path) -> list[Path]:
    """Return the folders below a path that hold images, those nearest first."""
    found, waiting, seen = [], deque([place]), 0
    while waiting and seen < _MOST_FOLDERS:
        folder = waiting.popleft()
        seen += 1
        try:
            waiting.extend(sorted(p for p in folder.iterdir() if p.is_dir() and not p.is_symlink()))
        except OSError:
            continue
        if FolderImages.of(folder).names:
            found.append(folder)
    return found
