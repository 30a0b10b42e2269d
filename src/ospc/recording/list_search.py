"""Lists of exposures in the folder of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ospc.errors import ExposureError, RecordingError, listed
from ospc.formats.files import schema_of
from ospc.recording.exposure_lists import IMAGE_LIST, read_list, read_times
from ospc.recording.frame_matching import match_images
from ospc.recording.frame_table import FrameTable
from ospc.recording.image_source import FolderImages, ImageSource
from ospc.recording.list_columns import columns_of
from ospc.recording.options import ReadingOptions
from ospc.recording.table_text import read_table_text

TIMES = "times.txt"
"""Name of the list of a TUM data set."""

IMAGES = "images"
"""Name of the folder of images in a TUM data set, whose list is always beside it."""

_NAMES = (TIMES, "exposures.txt", "exposures.csv", IMAGE_LIST)
TEXT_SUFFIXES = (".csv", ".txt", ".json")
"""Suffixes of files that the user may take for a list of exposures."""

_ADVICE = (
    "add times.txt with lines 'id stamp[s] exposure[ms]', or exposures.csv with a header "
    "'file,timestamp_s,exposure_ms'"
)

_HEAD_CHARACTERS = 65536
"""Number of characters at the beginning of a table that are searched for a header."""

MOST_LOOKED_INTO = 100
"""Maximum number of files or folders in a folder that are searched for lists, images or recordings."""


def lists_in(folder: Path) -> list[Path]:
    """Return the lists of exposures in a folder, recognised by name or header."""
    named = [folder / name for name in _NAMES if (folder / name).is_file()]
    csv_files = [p for p in sorted(folder.glob("*.csv")) if p.is_file() and p not in named][:MOST_LOOKED_INTO]
    return named + [p for p in csv_files if names_exposures(p)]


def names_exposures(path: Path) -> bool:
    """Return whether a file exists whose header, which may be a comment, names a column of exposures."""
    try:
        text = read_table_text(path)
        if len(text) > _HEAD_CHARACTERS:
            text = text[:_HEAD_CHARACTERS].rpartition("\n")[0] or text
        columns, _ = columns_of(text, str(path))
    except ExposureError:
        return True
    except RecordingError:
        return False
    return columns.named and columns.exposure is not None


def _lists_beside(images: Path) -> list[Path]:
    """Return the lists of exposures beside a folder or archive of images; none if they may be of other images."""
    full = images if images.name not in ("", "..") else images.resolve()  # such as '.'
    if full.stem == IMAGES:
        times = full.parent / TIMES
        return [times] if times.is_file() else lists_in(full.parent)
    return lists_in(full.parent) if only_image_folder(full.parent) == full else []


def only_image_folder(place: Path) -> Path | None:
    """Return the folder with images in another folder; None if there are several, or images next to it."""
    inner: list[Path] = []
    with suppress(OSError):  # a folder that cannot be listed says nothing
        inner = [path for path in place.iterdir() if path.is_dir()]
    found = [path for path in inner if _has_images(path)] if len(inner) <= MOST_LOOKED_INTO else []
    found = [path for path in found if not is_output(path)]
    return found[0] if len(found) == 1 and not _has_images(place) else None


def is_output(place: Path) -> bool:
    """Return whether a folder has corrected images, or the result of a calibration and no images of a recording.

    Such folders may be inside the folder of a recording. They are recordings only for those who name them.
    """
    with suppress(OSError):  # a folder that cannot be searched says nothing
        if schema_of(place / "correction.json") == "ospc-correction":
            return True
        if any((place / name).exists() for name in (IMAGES, f"{IMAGES}.zip")):
            return False
        return schema_of(place / "calibration.json") == "ospc-calibration" or (place / "state.ospc").is_file()
    return False


def _has_images(folder: Path) -> bool:
    """Return whether a folder has images; False if it cannot be listed."""
    with suppress(RecordingError):
        return bool(FolderImages.of(folder).names)
    return False


def read_list_of(images: ImageSource, path: Path, options: ReadingOptions) -> FrameTable:
    """Read the list of exposures in the folder of some images, or else the one beside it; ``path`` is what is opened.

    Raises
    ------
    ExposureError
        If there is no list, there are several, or one beside the images cannot be read or belongs to others.
    RecordingError
        If a list in the folder of the images, or the ``times.txt`` of an opened TUM data set, cannot be read.
    """
    place = images.place
    if place.is_dir() and (inside := lists_in(place)):
        return read_list(only_list(inside, place), options, images=images.names)
    found = only_list(_lists_beside(place), path, _ADVICE)
    tum = found.name == TIMES  # outside the folder of the images, it is in the format of TUM data sets
    try:
        table = read_times(found, options) if tum else read_list(found, options, images=images.names)
        match_images(table, images.names, str(place))
    except RecordingError as error:
        if tum and found.parent == path:
            raise
        raise ExposureError(str(error)) from None
    said = () if found.parent == path else (f"{found}: exposures are read from this list",)
    return replace(table, notes=(*said, *table.notes))


def only_list(found: Sequence[Path], place: Path, advice: str = "") -> Path:
    """Return the only list of exposures of a place.

    Raises
    ------
    ExposureError
        If there are several, or none; then the message ends with the ``advice``.
    """
    if len(found) > 1:
        named = [path.name if path.parent in (place, place.parent) else path for path in found]
        raise ExposureError(f"{place}: has several lists of exposures ({listed(named)}); keep only the right one")
    if not found:
        folder = place if place.is_dir() else place.parent
        others = sorted(p for p in folder.iterdir() if p.suffix.lower() in TEXT_SUFFIXES)
        for path in [p for p in others if p.suffix.lower() == ".csv"][:MOST_LOOKED_INTO]:
            check_text(path, place)
        needed = "a list is a CSV file with a column such as exposure_ms"
        unused = f" (not used: {listed([p.name for p in others])}; {needed})" if others else ""
        raise ExposureError(f"{place}: has no list of exposures{unused}; {advice}")
    return found[0]


def check_text(path: Path, place: Path) -> None:
    """Raise an ExposureError if a file that may be the list of exposures of a place is not text."""
    try:
        if path.is_file():
            read_table_text(path)
    except RecordingError as error:
        raise ExposureError(f"{place}: has no list of exposures that can be read: {error}") from None
