"""A folder of photographs with exposures in their EXIF.

The exposure is time × ISO/100 / N², where N is the f-number. EXIF rounds all three values, for example a time of 1/64
to the nominal 1/60, so that ratios have errors of a few per cent.
"""

from __future__ import annotations

from pathlib import Path

from ospc.errors import ExposureError, FrameError, RecordingError, listed, os_error_as
from ospc.formats.files import beginning, read_bytes
from ospc.formats.image_header import EXIF, exif_block
from ospc.recording.frame_table import FrameTable, make_table
from ospc.recording.image_formats import Shot, format_of, shot_of_exif
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import MAX_FILE_BYTES, FolderImages
from ospc.recording.list_search import lists_in
from ospc.recording.options import DEFAULT, ReadingOptions

_HEAD_BYTES = 256 * 1024
"""Bytes read from each photograph: EXIF is a segment of at most 64 KiB near the beginning."""

_FORMULA = "exposure is time × ISO/100 / f-number², from EXIF, in ms; EXIF rounds these values"
_LIST_INSTEAD = "add exposures.csv with a header 'file,exposure_s'"


class _ExifPhotos:
    name = "exif_photos"

    def recognises(self, path: Path) -> bool:
        if not path.is_dir():
            return False
        names = FolderImages.of(path).names
        if not names or lists_in(path):
            return False
        return format_of(names[0]) is not None or EXIF in _head(path / names[0])

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        source = FolderImages.of(path)
        return open_sequence(path, self.name, source, lambda: _table(path, source.names), options=options)


def _photo(path: Path) -> tuple[float, Shot]:
    """Return the exposure of a photograph in ms, and its EXIF data."""
    optional = format_of(path)
    if optional is None:
        head = _head(path)
        shot = shot_of_exif(exif_block(head) or head)
    else:
        try:
            shot = optional.shot(read_bytes(path, MAX_FILE_BYTES, FrameError), str(path))
        except FrameError as error:
            raise ExposureError(f"{error}, or remove the photograph") from None
    if shot.time_s is None:
        raise ExposureError(f"{path}: its EXIF has no exposure time; remove the photograph, or {_LIST_INSTEAD}")
    return 1000 * shot.time_s * (shot.iso or 100) / 100 / (shot.f_number or 1) ** 2, shot


def _head(path: Path) -> bytes:
    with os_error_as(RecordingError, f"{path}: cannot be read", "check the file and its permissions"):
        return beginning(path, _HEAD_BYTES)


def _table(path: Path, names: tuple[str, ...]) -> FrameTable:
    """Order the photographs by the time at which they were taken, or by name if these times are not unique."""
    photos = [_photo(path / name) for name in names]
    shots = [shot for _, shot in photos]
    notes = _notes(path, names, shots)
    stamps = [shot.taken for shot in shots if shot.taken is not None]
    if len(set(stamps)) < len(shots):
        seconds = [float(index) for index in range(len(shots))]
        notes.append(f"{path}: frames are ordered by name, one per second")
    else:
        first = min(stamps)
        seconds = [(taken - first).total_seconds() for taken in stamps]
        notes.append(f"{path}: time stamps are relative to the first photograph")
    rows = sorted(zip(seconds, names, (exposure_ms for exposure_ms, _ in photos), strict=True))
    stamps_s, ordered, exposures_ms = zip(*rows, strict=True)
    return make_table(str(path), ordered, stamps_s, exposures_ms, notes)


def _notes(path: Path, photos: tuple[str, ...], shots: list[Shot]) -> list[str]:
    """Return notes on the formula and on values that are missing or change; raise an error if inconsistent."""
    notes = [f"{path}: {_FORMULA}"]
    values = {"ISO": [shot.iso for shot in shots], "f-number": [shot.f_number for shot in shots]}
    for what, stated in values.items():
        names = [name for name, value in zip(photos, stated, strict=True) if value is None]
        if 0 < len(names) < len(photos):
            raise ExposureError(
                f"{path}: EXIF states the {what} of some photographs but not of {listed(names)}; "
                f"remove these, or {_LIST_INSTEAD}"
            )
        if names:
            notes.append(f"{path}: EXIF states no {what}; it is assumed to be the same in all photographs")
    of_lens = {"f-number": values["f-number"], "focal length": [shot.focal_mm for shot in shots]}
    notes += [
        f"{path}: the {what} changes, and with it the vignette; use photographs of one {what}"
        for what, stated in of_lens.items()
        if len(set(stated)) > 1
    ]
    models = sorted({shot.model or "unknown" for shot in shots})
    if len(models) > 1:
        raise RecordingError(f"{path}: photographs of several cameras ({listed(models)}); keep those of one")
    return notes


KIND = _ExifPhotos()
