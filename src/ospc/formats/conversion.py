"""Any recording as a folder in the layout of the TUM monocular data set, which DSO and its descendants read."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import FormatError, FrameError, RecordingError, SettingError
from ospc.formats.dso import write_times
from ospc.formats.files import read_bytes, write_bytes
from ospc.recording.frame import Frame
from ospc.recording.image_header import read_header
from ospc.recording.image_sequence import ImageSequence
from ospc.recording.recording import Recording

ImageFormat = Literal["png", "jpg"]

_PNG, _JPEG = b"\x89PNG", b"\xff\xd8"
_PNG_COMPRESSION = 3
_JPEG_QUALITY = 97
_EXIF_WITHIN = 65536
_CAMERA, _CAMERA_BYTES = "camera.txt", 65536
_REASONS = 3


@dataclass(frozen=True)
class Converted:
    """What a conversion wrote.

    Attributes
    ----------
    path
        The folder.
    frames
        Number of images.
    copied
        How many of them are copies of the files, byte by byte; the others were coded anew.
    skipped
        Number of frames left out because they cannot be read.
    notes
        What a user should know.
    """

    path: Path
    frames: int
    copied: int
    skipped: int
    notes: tuple[str, ...]


def convert_recording(
    recording: Recording,
    out: str | Path,
    *,
    image_format: ImageFormat | None = None,
    archive: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Converted:
    """Write a recording as ``images/`` or ``images.zip``, ``times.txt`` and, if it has one, ``camera.txt``.

    Frame by frame. Image files that programs read as this one does are copied; others are coded anew, those of more
    than 8 bit left-aligned in 16, since programs that want 8 bit take the upper ones. ``times.txt`` comes last, and
    what was written is removed if anything fails: a folder with a ``times.txt`` is complete.

    Parameters
    ----------
    recording
        The recording.
    out
        A new or empty folder.
    image_format
        ``"png"`` or ``"jpg"`` (8 bit, lossy); where None, that of the files where they can be copied, else PNG.
    archive
        Whether to write ``images.zip`` instead of the folder ``images``.
    progress
        Called with the number of frames done and of all.

    Raises
    ------
    SettingError
        If the folder is not empty or cannot be written.
    RecordingError
        If not one frame can be read, or time stamps fall together when written to the nanosecond.
    """
    place = Path(out)
    existed = _check_empty(place)
    try:
        place.mkdir(parents=True, exist_ok=True)
        with _Images(place, archive=archive) as images:
            written, copied, problems = _write_frames(recording, images, image_format, progress)
        notes = [*_about_coding(recording, len(written) - copied, image_format), *_copy_camera(recording, place)]
        write_times(
            place / "times.txt", range(len(written)), recording.stamps_s[written], recording.exposures_ms[written]
        )
    except BaseException as error:  # an interruption, too, leaves nothing half done
        _remove(place, existed=existed)
        if isinstance(error, OSError):
            reason = error.strerror or str(error)
            raise SettingError(f"{place}: cannot be written ({reason}); choose another folder") from None
        raise
    if problems:
        notes.insert(0, f"{len(problems)} frames were left out: {'; '.join(problems[:_REASONS])}")
    return Converted(place, len(written), copied, len(problems), tuple(notes))


class _Images:
    """Numbered images in a folder or an archive."""

    def __init__(self, place: Path, *, archive: bool) -> None:
        self._folder = place / "images"
        self._archive = zipfile.ZipFile(place / "images.zip", "w") if archive else None
        if self._archive is None:
            self._folder.mkdir()

    def write(self, number: int, data: bytes) -> None:
        name = f"{number:05d}{'.jpg' if data.startswith(_JPEG) else '.png'}"
        if self._archive is None:
            (self._folder / name).write_bytes(data)
        else:
            # A fixed date keeps archives of the same recording identical.
            self._archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)

    def __enter__(self) -> _Images:
        return self

    def __exit__(self, *_: object) -> None:
        if self._archive is not None:
            self._archive.close()


def _check_empty(place: Path) -> bool:
    """Return whether the folder exists; refuse one that cannot be used."""
    try:
        if place.exists() and not place.is_dir():
            raise SettingError(f"{place}: is a file; name a folder for the output")
        if place.is_dir() and any(place.iterdir()):
            raise SettingError(f"{place}: is not empty; choose another folder, or remove what is there")
        return place.exists()
    except OSError as error:
        raise SettingError(f"{place}: cannot be used for output ({error.strerror}); choose another") from None


def _write_frames(
    recording: Recording,
    images: _Images,
    image_format: ImageFormat | None,
    progress: Callable[[int, int], None] | None,
) -> tuple[list[int], int, list[str]]:
    """Return the indices of the frames written, how many were copied, and why others were left out."""
    written: list[int] = []
    problems: list[str] = []
    copied = 0
    for frame in recording:
        try:
            data = _stored(recording, frame.index, image_format)
            copied += data is not None
            images.write(len(written), data if data is not None else _coded(frame, image_format or "png"))
            written.append(frame.index)
        except FrameError as error:
            problems.append(str(error))
        if progress is not None:
            progress(frame.index + 1, len(recording))
    if not written:
        raise RecordingError(f"{recording.path}: none of its frames can be read; the first: {problems[:1]}")
    if np.any(np.diff(np.round(recording.stamps_s[written], 9)) <= 0):
        raise RecordingError(f"{recording.path}: time stamps are less than a nanosecond apart; scale them")
    return written, copied, problems


def _stored(recording: Recording, index: int, image_format: ImageFormat | None) -> bytes | None:
    """Return the file of a frame if other programs read the same image from it, None if it must be coded anew.

    Raises
    ------
    FrameError
        If it is damaged.
    """
    if not isinstance(recording, ImageSequence) or recording.layout.green is not None:
        return None
    data = recording.stored_bytes(index)
    kind = "png" if data.startswith(_PNG) else "jpg" if data.startswith(_JPEG) else None
    if kind is None or image_format not in (None, kind):
        return None
    # An orientation would be applied by others, and is not by this reader.
    if kind == "jpg" and b"Exif\0" in data[:_EXIF_WITHIN]:
        return None
    depth = recording.layout.depth
    header = read_header(data, recording.source.label(recording.names[index]))
    same = (header.width, header.height) == recording.layout.stored_size and header.bits == depth.stored_bits
    # JPEG stores luma beside colour; the conversions of other formats differ between programs.
    grey = header.channels == 1 or kind == "jpg"
    aligned = depth.stored_bits == depth.bits + depth.shift
    return data if same and grey and aligned else None


def _coded(frame: Frame, image_format: ImageFormat) -> bytes:
    """Code the image of a frame.

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
    done, coded = cv2.imencode(f".{image_format}", image, options)
    if not done:
        raise FrameError(f"{frame.name}: the image cannot be coded as {image_format}")
    return bytes(coded)


def _for_others(image: Image, max_grey: int, *, only_8_bit: bool) -> Image:
    """Return an image as programs expect it: 8 bit, or left-aligned in 16."""
    bits = max(max_grey.bit_length(), 8)
    if image.dtype == np.uint8:
        return image
    if only_8_bit or bits == 8:
        return (image >> (bits - 8)).astype(np.uint8)
    return np.left_shift(image, 16 - bits)


def _about_coding(recording: Recording, coded: int, image_format: ImageFormat | None) -> list[str]:
    bits = recording.max_grey.bit_length()
    if not coded or bits <= 8:
        return []
    if image_format == "jpg":
        return [f"grey values of {bits} bit were cut to their upper 8, which is all that JPEG holds"]
    return [f"grey values of {bits} bit are left-aligned in 16-bit images"] if bits < 16 else []


def _copy_camera(recording: Recording, place: Path) -> list[str]:
    """Copy camera.txt where there is one that belongs to these images; return what to say about it."""
    source = recording.path / _CAMERA
    if not source.is_file():
        return []
    if isinstance(recording, ImageSequence) and recording.layout.green is not None:
        return [f"{source} was not copied: its size is that of the mosaic, twice that of the images"]
    try:
        write_bytes(place / _CAMERA, read_bytes(source, _CAMERA_BYTES))
    except FormatError as error:
        return [f"{_CAMERA} was not copied: {error}"]
    return []


def _remove(place: Path, *, existed: bool) -> None:
    """Remove what was written into a folder that was empty before."""
    shutil.rmtree(place / "images", ignore_errors=True)
    for name in ("images.zip", _CAMERA, "times.txt"):
        (place / name).unlink(missing_ok=True)
    if not existed and place.is_dir() and not any(place.iterdir()):
        place.rmdir()
