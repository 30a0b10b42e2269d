"""A folder with images and a list of their exposures."""

from __future__ import annotations

from pathlib import Path

from ospc.errors import RecordingError
from ospc.recording.exposure_lists import read_list
from ospc.recording.frame_table import FrameTable
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.list_search import lists_beside, lists_in, only_list, read_beside
from ospc.recording.options import DEFAULT, ReadingOptions

_ADVICE = (
    "add times.txt with lines 'id stamp[s] exposure[ms]', or exposures.csv with a header "
    "'file,timestamp_s,exposure_ms'"
)


class _ImageFolder:
    name = "image_folder"

    def recognises(self, path: Path) -> bool:
        return path.is_dir() and bool(FolderImages.of(path).names)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        if not path.is_dir():
            raise RecordingError(f"{path}: a {self.name} recording is a folder with images and a list of exposures")
        images = FolderImages.of(path)

        def table() -> FrameTable:
            if lists := lists_in(path):
                return read_list(only_list(lists, path), options, images=images.names)
            if beside := lists_beside(path):
                return read_beside(only_list(beside, path), images, options)
            return read_list(only_list((), path, _ADVICE), options)

        return open_sequence(path, self.name, images, table, options=options)


KIND = _ImageFolder()
