"""A folder with images and a list of their exposures."""

from __future__ import annotations

from pathlib import Path

from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.list_search import read_list_of
from ospc.recording.options import DEFAULT, ReadingOptions


class _ImageFolder:
    name = "image_folder"

    def recognises(self, path: Path) -> bool:
        return path.is_dir() and bool(FolderImages.of(path).names)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        images = FolderImages.of(path)
        return open_sequence(path, self.name, images, lambda: read_list_of(images, path, options), options=options)


KIND = _ImageFolder()
