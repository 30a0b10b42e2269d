"""Folders like those of the TUM monocular dataset: ``images/`` or ``images.zip``, and ``times.txt``.

The ``dso/cam0`` folders of the TUM visual-inertial dataset have the same layout.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ospc.errors import ExposureError, RecordingError
from ospc.recording.frame_table import FrameTable, table_or_unlisted
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages, ImageSource, ZipImages
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.times_file import read_times

_FOLDER, _ARCHIVE, _TIMES = "images", "images.zip", "times.txt"


@dataclass(frozen=True)
class TumMono:
    """The kind of recording with ``images/`` or ``images.zip`` beside ``times.txt``."""

    name: str = "tum_mono"

    def recognises(self, path: Path) -> bool:
        """Tell whether the path is a folder that contains them."""
        return (path / _FOLDER).is_dir() or (path / _ARCHIVE).is_file()

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        """Open the folder.

        Raises
        ------
        RecordingError
            If a part is missing or unreadable, or images and times do not correspond.
        ExposureError
            If exposures are missing or invalid.
        """
        if not path.is_dir():
            raise RecordingError(f"{path}: a {self.name} recording is a folder with {_FOLDER}/ and {_TIMES}")
        times = path / _TIMES
        if not times.is_file() and not options.unknown_exposures:
            raise RecordingError(
                f"{path}: has no {_TIMES}; add it with a line 'id stamp[s] exposure[ms]' for each image"
            )
        if times.is_file() and not options.unknown_exposures:
            table = read_times(times, options)
        source, notes = _images(path)
        if options.unknown_exposures:
            table = _without_exposures(times, options, source)
        return open_sequence(path, self.name, source, table, notes, options=options)


def _without_exposures(times: Path, options: ReadingOptions, source: ImageSource) -> FrameTable:
    """Return the frames with exposures if they can be read."""

    def read() -> FrameTable:
        if not times.is_file():
            raise ExposureError(f"{times}: does not exist")
        return read_times(times, options)

    return table_or_unlisted(read, str(source.place), len(source.names), allowed=True)


def _images(path: Path) -> tuple[ImageSource, tuple[str, ...]]:
    """Return the images in the folder, or in the archive if the folder is empty or missing."""
    folder, archive = path / _FOLDER, path / _ARCHIVE
    if folder.is_dir():
        files = FolderImages.of(folder)
        if files.names:
            return files, (f"{archive} is ignored because {_FOLDER}/ holds images",) if archive.is_file() else ()
        if not archive.is_file():
            raise RecordingError(f"{folder}: holds no images; put the PNG, JPEG, TIFF, BMP, PGM or PPM files there")
    if not archive.is_file():
        raise RecordingError(f"{path}: has neither {_FOLDER}/ nor {_ARCHIVE}; put the images there")
    members = ZipImages.of(archive)
    if not members.names:
        members.close()
        raise RecordingError(f"{archive}: holds no images; it must hold PNG, JPEG, TIFF, BMP, PGM or PPM files")
    return members, ()


KIND = TumMono()
