"""Folders like those of the TUM monocular data set: ``images/`` or ``images.zip``, and ``times.txt``.

The ``dso/cam0`` folders of the TUM visual-inertial data set have the same layout.
"""

from __future__ import annotations

from pathlib import Path

from ospc.errors import ExposureError, RecordingError
from ospc.recording.exposure_lists import read_times
from ospc.recording.frame_table import FrameTable
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages, ImageSource, ZipImages
from ospc.recording.options import DEFAULT, ReadingOptions

_FOLDER, _ARCHIVE, _TIMES = "images", "images.zip", "times.txt"


class _TumMono:
    name = "tum_mono"

    def recognises(self, path: Path) -> bool:
        return (path / _FOLDER).is_dir() or (path / _ARCHIVE).is_file()

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        if not path.is_dir():
            raise RecordingError(f"{path}: a {self.name} recording is a folder with {_FOLDER}/ and {_TIMES}")
        times = path / _TIMES

        def table() -> FrameTable:
            if not times.is_file():
                if (path / _FOLDER / _TIMES).is_file():
                    raise ExposureError(f"{path}: has no {_TIMES}; move it there from {_FOLDER}/")
                raise ExposureError(
                    f"{path}: has no {_TIMES}; add it with a line 'id stamp[s] exposure[ms]' for each image"
                )
            return read_times(times, options)

        source, notes = _images(path)
        return open_sequence(path, self.name, source, table, notes, options=options)


def _images(path: Path) -> tuple[ImageSource, tuple[str, ...]]:
    """Return the images in the folder, or in the archive if the folder is empty or missing, and notes."""
    folder, archive = path / _FOLDER, path / _ARCHIVE
    if folder.is_dir():
        files = FolderImages.of(folder)
        if not archive.is_file():
            return files, ()
        if files.names:
            return files, (f"{archive} is ignored because {_FOLDER}/ contains images",)
    if not archive.is_file():
        raise RecordingError(f"{path}: has neither {_FOLDER}/ nor {_ARCHIVE}; put the images there")
    return ZipImages.of(archive), ()


KIND = _TumMono()
