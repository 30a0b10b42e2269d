"""Image formats that optional libraries decode."""

from __future__ import annotations

from pathlib import PurePath
from typing import Protocol

from ospc.recording.channel import Channel
from ospc.recording.heic import HEIC
from ospc.recording.pixel_layout import StoredImage
from ospc.recording.raw import RAW
from ospc.recording.shot import Shot


class ImageFormat(Protocol):
    """Decodes the files of one format; all its methods raise MissingExtraError without its library."""

    @property
    def suffixes(self) -> frozenset[str]:
        """Suffixes of its files, in lower case."""
        ...

    def decode(self, data: bytes, name: str, channel: Channel | None) -> StoredImage:
        """Decode a file, called ``name`` in messages, to one channel; FrameError if that fails."""
        ...

    def shot(self, data: bytes, name: str) -> Shot:
        """Return how a photograph was taken; FrameError if the file is damaged."""
        ...

    def exif(self, data: bytes) -> bytes:
        """Return the EXIF block that a corrected copy gets, from its mark 'Exif' on; empty if there is none."""
        ...


_FORMATS: tuple[ImageFormat, ...] = (HEIC, RAW)


def format_of(name: str | PurePath) -> ImageFormat | None:
    """Return the format of a file name; None for those that need no optional library, and all other files."""
    suffix = PurePath(name).suffix.lower()
    return next((known for known in _FORMATS if suffix in known.suffixes), None)
