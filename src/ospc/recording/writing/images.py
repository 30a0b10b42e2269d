"""Writing of images as numbered files, copied or encoded, and recording of a live camera."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ospc.errors import RecordingError
from ospc.formats.dso import write_times
from ospc.formats.image_files import encoded
from ospc.formats.image_header import JPEG_START, PNG_SIGNATURE, read_header
from ospc.recording.derived import innermost
from ospc.recording.frame import Frame
from ospc.recording.image_sequence import ImageSequence
from ospc.recording.recording import Recording
from ospc.system.atomic import write_atomically
from ospc.system.folders import NOT_EMPTY, check_usable, writing

ImageFormat = Literal["png", "jpg"]

_PNG_COMPRESSION = 3
"""zlib level: higher ones take several times as long for files a few per cent smaller."""

_EXIF_WITHIN = 65536
"""Number of bytes at the start of a JPEG that may contain its EXIF segment."""

_DIGITS = 5
"""Minimum number of digits in an image number, as in the TUM monocular data set."""


def numbered(number: int, count: int) -> str:
    """Return the number of one of ``count`` images as text of constant length, because programs sort it as text."""
    return f"{number:0{max(_DIGITS, len(str(count - 1)))}d}"


class NumberedImages(AbstractContextManager["NumberedImages"]):
    """Writes at most ``count`` numbered images to a folder ``images`` or an archive ``images.zip``."""

    def __init__(self, place: Path, count: int, *, archive: bool) -> None:
        self._count = count
        self._folder = place / "images"
        self._archive = zipfile.ZipFile(place / "images.zip", "w") if archive else None
        if self._archive is None:
            self._folder.mkdir(parents=True)

    def write(self, number: int, data: bytes) -> None:
        """Write an image file."""
        name = f"{numbered(number, self._count)}{'.jpg' if data.startswith(JPEG_START) else '.png'}"
        if self._archive is None:
            # Atomically, so that a full disk leaves no image without an exposure.
            write_atomically(self._folder / name, data, durable=False)
        else:
            # A fixed date makes archives of the same recording identical.
            self._archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)

    def __exit__(self, *_: object) -> None:
        if self._archive is not None:
            self._archive.close()


def original_file(recording: Recording, frame: Frame, image_format: ImageFormat | None) -> bytes | None:
    """Return the file of a frame if every program reads the same image from it; None if it must be encoded again.

    The image must have been read before, which verifies the file. ``image_format`` is the only accepted format; None
    for any.

    Raises
    ------
    FrameError
        If the file can no longer be read.
    """
    source, index = innermost(recording, frame.index)
    if not isinstance(source, ImageSequence) or source.layout.mosaic is not None:
        return None
    data = source.stored_bytes(index)
    kind = "png" if data.startswith(PNG_SIGNATURE) else "jpg" if data.startswith(JPEG_START) else None
    if kind is None or image_format not in (None, kind):
        return None
    # Other programs apply the EXIF orientation; this package does not.
    if b"eXIf" in data if kind == "png" else b"Exif\0" in data[:_EXIF_WITHIN]:
        return None
    depth = source.layout.depth
    header = read_header(data, source.source.label(source.names[index]))
    same = (header.width, header.height) == source.layout.stored_size and header.bits == depth.stored_bits
    aligned = depth.stored_bits == depth.bits + depth.shift
    # Of colour images, other programs read the luma, and this package the green channel.
    return data if same and header.channels == 1 and aligned else None


def encode(frame: Frame, image_format: ImageFormat) -> bytes:
    """Encode the image of a frame in 8 bits, or left-aligned in 16, so that the upper byte is the 8-bit image."""
    image, bits = frame.image, max(frame.max_grey.bit_length(), 8)
    if image.dtype != np.uint8:
        only_8_bit = image_format == "jpg" or bits == 8
        image = (image >> (bits - 8)).astype(np.uint8) if only_8_bit else np.left_shift(image, 16 - bits)
    return encoded(image, f".{image_format}", frame.name, png_compression=_PNG_COMPRESSION)


def encoding_notes(recording: Recording, number: int, image_format: ImageFormat | None) -> list[str]:
    """Return notes if images, ``number`` of them, were encoded again."""
    bits = recording.max_grey.bit_length()
    if not number or bits <= 8:
        return []
    if image_format == "jpg":
        return [f"{bits}-bit grey values were reduced to their upper 8 bits, because JPEG has only 8"]
    return [f"{bits}-bit grey values are left-aligned in 16-bit images"] if bits < 16 else []


_CLOCK_STEP_S = 1.0
"""A stamp this much earlier than the previous one shows that the clock was set."""

MOST_FRAMES = 1_000_000
"""Maximum number of frames in a recording: nine hours at 30 per second."""


@dataclass(frozen=True)
class Filmed:
    """The folder, its number of images, and the shortest and longest exposure.

    ``repeated`` frames were left out because their time stamps were not later than the previous one. Where the clock
    was set back, ``clock_steps`` times, the stamps continue.
    """

    path: Path
    frames: int
    repeated: int
    clock_steps: int
    exposure_range_ms: tuple[float, float]


def film(
    frames: Iterable[Frame],
    out: str | Path,
    *,
    most: int = MOST_FRAMES,
    stop: Callable[[], bool] = lambda: False,
    progress: Callable[[int, int], None] = lambda _done, _most: None,
) -> Filmed:
    """Write frames as they arrive, in the layout of the TUM monocular data set.

    The folder ``out`` must be new or empty. Writing stops after ``most`` frames, or when ``stop``, called after every
    frame, returns True. ``progress`` is called with the number of frames written and ``most``. Errors of the frames
    are passed on; the frames written until then are always a complete recording.

    Raises
    ------
    SettingError
        If the folder is not empty or cannot be written to.
    RecordingError
        If no frame arrives.
    """
    place = Path(out)
    check_usable(place, content_of=lambda _place: NOT_EMPTY)
    stamps_s: list[float] = []
    exposures_ms: list[float] = []
    repeated = clock_steps = 0
    ahead_s = 0.0  # by how much the stamps written are ahead of those of the camera
    try:
        with writing(place), NumberedImages(place, most, archive=False) as images:
            for frame in frames:
                later_s = round(frame.stamp_s + ahead_s - stamps_s[-1], 9) if stamps_s else math.inf
                if later_s < -_CLOCK_STEP_S:
                    interval_s = float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else _CLOCK_STEP_S
                    ahead_s, later_s, clock_steps = ahead_s - later_s + interval_s, interval_s, clock_steps + 1
                if later_s <= 0:
                    repeated += 1
                else:
                    images.write(len(stamps_s), encode(frame, "png"))
                    stamps_s.append(frame.stamp_s + ahead_s)
                    exposures_ms.append(frame.exposure_ms)
                    progress(len(stamps_s), most)
                if stop() or len(stamps_s) >= most:
                    break
    finally:
        if stamps_s:
            write_times(place / "times.txt", range(len(stamps_s)), stamps_s, exposures_ms)
    if not stamps_s:
        raise RecordingError(f"{place}: the camera delivered no frames; check that it is running")
    return Filmed(place, len(stamps_s), repeated, clock_steps, (min(exposures_ms), max(exposures_ms)))
