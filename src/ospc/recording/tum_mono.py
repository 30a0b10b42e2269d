"""Folders like those of the TUM monocular data set: ``images/`` or ``images.zip``, and ``times.txt``.

The ``dso/cam0`` folders of the TUM visual-inertial data set have the same layout.
"""

from __future__ import annotations

from pathlib import Path

from ospc.errors import RecordingError
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages, ImageSource, ZipImages
from ospc.recording.list_search import IMAGES, read_list_of
from ospc.recording.options import DEFAULT, ReadingOptions

_ARCHIVE = f"{IMAGES}.zip"


class _TumMono:
    name = "tum_mono"

    def recognises(self, path: Path) -> bool:
        return (path / IMAGES).is_dir() or (path / _ARCHIVE).is_file()

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        source, notes = _images(path)
        return open_sequence(
            path, self.name, source, lambda: read_list_of(source, path, options), notes, options=options
        )


def _images(path: Path) -> tuple[ImageSource, tuple[str, ...]]:
    """Return the images in the folder, or in the archive if the folder is empty or missing, and notes."""
    folder, archive = path / IMAGES, path / _ARCHIVE
    if folder.is_dir():
        files = FolderImages.of(folder)
        if not archive.is_file():
            return files, ()
        if files.names:
            return files, (f"{archive} is ignored because {IMAGES}/ contains images",)
    if not archive.is_file():
        raise RecordingError(f"{path}: has neither {IMAGES}/ nor {_ARCHIVE}; put the images there")
    return ZipImages.of(archive), ()


KIND = _TumMono()
