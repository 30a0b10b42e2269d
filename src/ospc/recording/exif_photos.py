"""A folder of photographs whose exposures are in the files themselves, as EXIF.

Exposure is time × ISO/100 / N², N the f-number: what the sensor gets from the same scene, times the gain it is read
with. EXIF rounds all three, times to the nominal 1/60 of a 1/64, so ratios are good to some per cent.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from io import BytesIO
from pathlib import Path
from typing import Any

from ospc.errors import ExposureError, RecordingError, listed, needs_extra
from ospc.recording.exposure_lists import lists_in
from ospc.recording.exposure_units import EXPOSURE_RANGE_MS
from ospc.recording.frame_table import FrameTable, make_table
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.options import DEFAULT, ReadingOptions

_HEAD_BYTES = 256 * 1024
"""Read of each photograph: EXIF is a segment of at most 64 KiB near its beginning."""

_SIGNATURE = b"Exif\0\0"
_TIME, _NUMBER, _ISO = "EXIF ExposureTime", "EXIF FNumber", "EXIF ISOSpeedRatings"
_TAKEN, _FRACTION, _MODEL = "EXIF DateTimeOriginal", "EXIF SubSecTimeOriginal", "Image Model"
_FORMULA = "exposure is time × ISO/100 / f-number², from EXIF, in ms; EXIF rounds these values"
_LIST_INSTEAD = "add exposures.csv with a header 'file,exposure_s'"


@dataclass(frozen=True)
class ExifPhotos:
    """The kind of recording that is a folder of photographs with EXIF and no list of exposures."""

    name: str = "exif_photos"

    def recognises(self, path: Path) -> bool:
        """Tell whether the path is a folder of images without a list of exposures, the first of which has EXIF."""
        if not path.is_dir():
            return False
        names = FolderImages.of(path).names
        return bool(names) and _SIGNATURE in _head(path / names[0]) and not lists_in(path)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        """Open the folder; frames are in the order the photographs were taken.

        Raises
        ------
        MissingExtraError
            If the optional dependency that reads EXIF is not installed.
        """
        if not path.is_dir():
            raise RecordingError(f"{path}: an {self.name} recording is a folder of photographs with EXIF")
        source = FolderImages.of(path)
        return open_sequence(path, self.name, source, lambda: _table(path, source.names), options=options)


@dataclass(frozen=True)
class _Photo:
    """EXIF values of a photograph."""

    name: str
    exposure_ms: float
    iso: float | None
    f_number: float | None
    taken: datetime | None
    model: str


def _photo(path: Path) -> _Photo:
    tags = _tags(path)
    time_s = _positive(tags, _TIME)
    if time_s is None:
        raise ExposureError(f"{path}: its EXIF holds no exposure time; remove the photograph, or {_LIST_INSTEAD}")
    iso, f_number = _positive(tags, _ISO), _positive(tags, _NUMBER)
    exposure_ms = 1000 * time_s * (iso or 100) / 100 / (f_number or 1) ** 2
    if not EXPOSURE_RANGE_MS[0] <= exposure_ms <= EXPOSURE_RANGE_MS[1]:
        raise ExposureError(
            f"{path}: its EXIF gives an impossible exposure of {exposure_ms:g} ms; remove the photograph, or "
            f"{_LIST_INSTEAD}"
        )
    return _Photo(path.name, exposure_ms, iso, f_number, _taken(tags), str(tags.get(_MODEL, "")))


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); check the file and its rights") from None


def _tags(path: Path) -> Mapping[str, Any]:
    """Return the EXIF tags of a photograph; none if its EXIF is damaged."""
    with needs_extra("reading exposures from photographs", "exif"):
        import exifread
    logger = logging.getLogger("exifread")
    if not logger.handlers:
        # Without a handler, its remarks on odd files would be printed.
        logger.addHandler(logging.NullHandler())
    try:
        tags: Mapping[str, Any] = exifread.process_file(BytesIO(_head(path)), details=False)
    except Exception:
        # The parser raises undocumented errors for damaged EXIF.
        return {}
    return tags


def _positive(tags: Mapping[str, Any], name: str) -> float | None:
    """Return the number in a tag, None if it is absent or not positive."""
    try:
        value = float(tags[name].values[0])
    except (KeyError, IndexError, AttributeError, TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return value if math.isfinite(value) and value > 0 else None


def _taken(tags: Mapping[str, Any]) -> datetime | None:
    digits = str(tags.get(_FRACTION, "0")).strip()[:6]
    fraction = digits if digits.isascii() and digits.isdigit() else "0"
    try:
        return datetime.strptime(f"{tags[_TAKEN]}.{fraction}", "%Y:%m:%d %H:%M:%S.%f")
    except (KeyError, ValueError):
        return None


def _table(path: Path, names: tuple[str, ...]) -> FrameTable:
    """Order the photographs by the time they were taken, or by name if several share a second."""
    photos = [_photo(path / name) for name in names]
    notes = _notes(path, photos)
    stamps = [photo.taken for photo in photos if photo.taken is not None]
    if len(stamps) < len(photos) or len(set(stamps)) < len(stamps):
        seconds = [float(index) for index in range(len(photos))]
        notes.append(f"{path}: frames are in the order of their names, one per second")
    else:
        first = min(stamps)
        seconds = [(taken - first).total_seconds() for taken in stamps]
        notes.append(f"{path}: time stamps count from the first photograph")
    order = sorted(range(len(photos)), key=seconds.__getitem__)
    return make_table(
        str(path),
        [photos[i].name for i in order],
        [seconds[i] for i in order],
        [photos[i].exposure_ms for i in order],
        notes,
    )


def _notes(path: Path, photos: list[_Photo]) -> list[str]:
    """Return notes on the formula and on values that are missing or change; refuse inconsistent ones."""
    notes = [f"{path}: {_FORMULA}"]
    without = {
        "ISO": [p.name for p in photos if p.iso is None],
        "f-number": [p.name for p in photos if p.f_number is None],
    }
    for what, names in without.items():
        if 0 < len(names) < len(photos):
            raise ExposureError(
                f"{path}: EXIF states the {what} of some photographs but not of {listed(names)}; "
                f"remove these, or {_LIST_INSTEAD}"
            )
        if names:
            notes.append(f"{path}: EXIF states no {what}; it is taken as the same in all photographs")
    if len({p.f_number for p in photos}) > 1:
        notes.append(f"{path}: the f-number changes, and the vignette with it; keep it fixed")
    models = sorted({p.model for p in photos})
    if len(models) > 1:
        raise RecordingError(f"{path}: photographs of several cameras ({listed(models)}); keep those of one")
    return notes


KIND = ExifPhotos()
