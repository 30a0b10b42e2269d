"""Images of a recording as files that other programs read: copied where that is possible, otherwise coded anew."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import FrameError
from ospc.recording.frame import Frame
from ospc.recording.image_header import read_header
from ospc.recording.image_sequence import ImageSequence
from ospc.recording.recording import Recording

ImageFormat = Literal["png", "jpg"]

_PNG, _JPEG = b"\x89PNG", b"\xff\xd8"
_PNG_COMPRESSION = 3
_JPEG_QUALITY = 97
_EXIF_WITHIN = 65536
_DIGITS = 5


class NumberedImages:
    """Numbered images in the folder ``images`` or the archive ``images.zip`` of a place.

    Parameters
    ----------
    place
        An existing folder.
    count
        Largest number of images; all names get as many digits, since programs sort them as text.
    archive
        Whether to write the archive.
    """

    def __init__(self, place: Path, count: int, *, archive: bool) -> None:
        self._digits = max(_DIGITS, len(str(count - 1)))
        self._folder = place / "images"
        self._archive = zipfile.ZipFile(place / "images.zip", "w") if archive else None
        if self._archive is None:
            self._folder.mkdir()

    def write(self, number: int, data: bytes) -> None:
        """Write the file of an image."""
        name = f"{number:0{self._digits}d}{'.jpg' if data.startswith(_JPEG) else '.png'}"
        if self._archive is None:
            (self._folder / name).write_bytes(data)
        else:
            # A fixed date keeps archives of the same recording identical.
            self._archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)

    def __enter__(self) -> NumberedImages:
        return self

    def __exit__(self, *_: object) -> None:
        if self._archive is not None:
            self._archive.close()


def stored(recording: Recording, frame: Frame, image_format: ImageFormat | None) -> bytes | None:
    """Return the file of a frame if other programs read the same image from it, None if it must be coded anew.

    Parameters
    ----------
    recording
        The recording.
    frame
        One of its frames.
    image_format
        The only format to take; any where None.

    Raises
    ------
    FrameError
        If it is damaged.
    """
    if not isinstance(recording, ImageSequence) or recording.layout.green is not None:
        return None
    data = recording.stored_bytes(frame.index)
    kind = "png" if data.startswith(_PNG) else "jpg" if data.startswith(_JPEG) else None
    if kind is None or image_format not in (None, kind):
        return None
    # An orientation would be applied by others, and is not by this reader.
    if kind == "jpg" and b"Exif\0" in data[:_EXIF_WITHIN]:
        return None
    depth = recording.layout.depth
    header = read_header(data, recording.source.label(recording.names[frame.index]))
    same = (header.width, header.height) == recording.layout.stored_size and header.bits == depth.stored_bits
    # JPEG stores luma beside colour; the conversions of other formats differ between programs.
    grey = header.channels == 1 or kind == "jpg"
    aligned = depth.stored_bits == depth.bits + depth.shift
    if not (same and grey and aligned):
        return None
    # A header says nothing of what follows it: only decoding tells whether the file is whole.
    _ = frame.image
    return data


def coded(frame: Frame, image_format: ImageFormat) -> bytes:
    """Code the image of a frame: 8 bit, or left-aligned in 16, of which programs that want 8 bit take the upper ones.

    Raises
    ------
    FrameError
        If its image cannot be read.
    """
    image = _for_others(frame.image, frame.max_grey, only_8_bit=image_format == "jpg")
    options = {
        "png": [cv2.IMWRITE_PNG_COMPRESSION, _PNG_COMPRESSION],
        "jpg": [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY],
    }[image_format]
    done, data = cv2.imencode(f".{image_format}", image, options)
    if not done:
        raise FrameError(f"{frame.name}: the image cannot be coded as {image_format}")
    return bytes(data)


def _for_others(image: Image, max_grey: int, *, only_8_bit: bool) -> Image:
    bits = max(max_grey.bit_length(), 8)
    if image.dtype == np.uint8:
        return image
    if only_8_bit or bits == 8:
        return (image >> (bits - 8)).astype(np.uint8)
    return np.left_shift(image, 16 - bits)


def about_coding(recording: Recording, number: int, image_format: ImageFormat | None) -> list[str]:
    """Return what to say about so many images coded anew."""
    bits = recording.max_grey.bit_length()
    if not number or bits <= 8:
        return []
    if image_format == "jpg":
        return [f"grey values of {bits} bit were cut to their upper 8, which is all that JPEG holds"]
    return [f"grey values of {bits} bit are left-aligned in 16-bit images"] if bits < 16 else []
