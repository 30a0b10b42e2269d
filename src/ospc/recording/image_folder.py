"""A folder with images and a list of their exposures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ospc.errors import ExposureError, RecordingError, listed
from ospc.recording.exposure_table import names_exposures, read_exposure_table
from ospc.recording.frame_table import FrameTable, table_or_unlisted
from ospc.recording.image_list import read_image_list
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.options import DEFAULT, ReadingOptions

_IMAGE_LIST = "image_list.txt"
_NAMES = ("times.txt", "exposures.txt", "exposures.csv", _IMAGE_LIST)
_MAX_CSV_FILES = 32
"""CSV files of a folder that are searched for exposures; more belong to something else."""


@dataclass(frozen=True)
class ImageFolder:
    """The kind of recording with images and a list of exposures in one folder."""

    name: str = "image_folder"

    def recognises(self, path: Path) -> bool:
        """Tell whether the path is a folder with images in it."""
        return path.is_dir() and bool(FolderImages.of(path).names)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        """Open the folder.

        Raises
        ------
        RecordingError
            If there are no images or they do not correspond to the list.
        ExposureError
            If there is no list of exposures, more than one, or one with missing or invalid exposures.
        """
        if not path.is_dir():
            raise RecordingError(f"{path}: a {self.name} recording is a folder with images and a list of exposures")
        source = FolderImages.of(path)
        if not source.names:
            raise RecordingError(f"{path}: holds no images; put the PNG, JPEG, TIFF, BMP, PGM or PPM files there")
        table = table_or_unlisted(
            lambda: read_exposures(_only_list(path), options),
            str(path),
            len(source.names),
            allowed=options.unknown_exposures,
        )
        return open_sequence(path, self.name, source, table, options=options)


def exposure_lists(path: Path) -> list[Path]:
    """Return the lists of exposures in a folder, recognised by their names or headers."""
    named = [path / name for name in _NAMES if (path / name).is_file()]
    csv_files = [p for p in sorted(path.glob("*.csv")) if p.is_file() and p not in named][:_MAX_CSV_FILES]
    return named + [p for p in csv_files if names_exposures(p)]


def _only_list(path: Path) -> Path:
    found = exposure_lists(path)
    if len(found) > 1:
        raise ExposureError(
            f"{path}: holds several lists of exposures ({listed([p.name for p in found])}); keep the one to use"
        )
    if found:
        return found[0]
    hint = ""
    if (path.parent / "times.txt").is_file():
        hint = f", or open {path.parent} if its times.txt belongs to these images"
    raise ExposureError(
        f"{path}: holds images but no list of their exposures; add times.txt with lines 'id stamp[s] exposure[ms]', "
        f"or exposures.csv with a header 'file,timestamp_s,exposure_ms'{hint}"
    )


def read_exposures(path: Path, options: ReadingOptions = DEFAULT) -> FrameTable:
    """Read a list of exposures in the format that its name implies."""
    return read_image_list(path) if path.name == _IMAGE_LIST else read_exposure_table(path, options)


KIND = ImageFolder()
