"""A folder with images and a list of their exposures."""

from __future__ import annotations

from pathlib import Path

from ospc.errors import RecordingError
from ospc.recording.exposure_lists import read_list, read_times
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.list_search import lists_in, only_list
from ospc.recording.options import DEFAULT, ReadingOptions


class _ImageFolder:
    name = "image_folder"

    def recognises(self, path: Path) -> bool:
        return path.is_dir() and bool(FolderImages.of(path).names)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        if not path.is_dir():
            raise RecordingError(f"{path}: a {self.name} recording is a folder with images and a list of exposures")
        advice = (
            "add times.txt with lines 'id stamp[s] exposure[ms]', or exposures.csv with a header "
            "'file,timestamp_s,exposure_ms'"
        )
        full, images = path.resolve(), FolderImages.of(path)
        if full.name == "images" and (full.parent / "times.txt").is_file():
            advice += f", or open {path.parent} if its times.txt belongs to these images"
        else:
            advice += "".join(
                f", or copy {p} there if it belongs to these images" for p in _times_above(full, len(images.names))
            )
        return open_sequence(
            path,
            self.name,
            images,
            lambda: read_list(only_list(lists_in(path), path, advice), options),
            options=options,
        )


def _times_above(folder: Path, images: int) -> list[Path]:
    """Return files times.txt with an exposure per image in the two parent folders, as in data sets of rigs."""
    found = []
    for above in folder.parents[:2]:
        try:
            lines = len(read_times(above / "times.txt"))
        except RecordingError:
            continue
        found += [above / "times.txt"] if lines == images else []
    return found


KIND = _ImageFolder()
