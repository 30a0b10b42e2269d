"""The images to correct: a recording, a folder, a video, or image files, with or without exposures."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ospc.errors import ExposureError, MissingExtraError, OspcError, RecordingError
from ospc.formats.dso import LARGEST_ID
from ospc.formats.files import by_name
from ospc.recording import Recording, open_recording
from ospc.recording.frame_table import FrameTable
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages, is_image_name, why_unread
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.writing.images import numbered


@dataclass(frozen=True)
class Source:
    """Images to correct.

    ``unexposed`` is the reason why exposures are unknown, or None; unknown exposures are set to 1 ms.
    """

    recording: Recording
    unexposed: OspcError | None = None

    def modified_ns(self, index: int) -> int | None:
        """Return the modification time of the file of an image in ns; None if the image has no file of its own."""
        recording = self.recording
        if isinstance(recording, ImageSequence) and isinstance(recording.source, FolderImages):
            return (recording.source.place / recording.names[index]).stat().st_mtime_ns
        return None

    def names(self) -> list[PurePosixPath]:
        """Return the file name of every image: the original name, or its number if it has none.

        Names only include folders if files in several folders have the same name.
        """
        recording = self.recording
        if not isinstance(recording, ImageSequence):
            return [PurePosixPath(numbered(index, len(recording))) for index in range(len(recording))]
        inner = [PurePosixPath(name) for name in recording.names]
        outer = [PurePosixPath(name.name) for name in inner]
        return outer if len(set(outer)) == len(outer) else inner


def ids_for(names: Sequence[PurePosixPath]) -> list[int] | None:
    """Return the ids of images in ``times.txt``: the numbers in their names, or their order.

    None if readers would assign either of them to wrong images.
    """
    stems = [name.stem for name in names]
    numbers = [int(stem) for stem in stems if stem.isascii() and stem.isdigit() and len(stem) <= 10]
    if len(numbers) == len(names) == len(set(numbers)) and max(numbers) <= LARGEST_ID:
        return numbers
    in_order = [str(name) for name in names]
    order = range(len(names))
    return list(order) if in_order == sorted(in_order, key=by_name) and not set(numbers) & set(order) else None


def open_source(paths: Sequence[str | Path], kind: str | None = None, options: ReadingOptions = DEFAULT) -> Source:
    """Open images to correct: one recording of any kind, with exposures or without, or image files and patterns.

    ``kind`` and ``options`` are as for :func:`~ospc.recording.kinds.open_recording`.

    Raises
    ------
    RecordingError
        If there are no images, or their list of exposures is damaged.
    """
    places = [place for path in paths for place in _expanded(Path(path))]
    if len(places) > 1 or (places[0].is_file() and is_image_name(places[0].name)):
        return _image_files(places, options)
    try:
        return Source(open_recording(places[0], kind, options))
    except (RecordingError, MissingExtraError) as error:
        # If it cannot be opened without exposures either, that error is raised.
        try:
            return Source(open_recording(places[0], kind, replace(options, unknown_exposures=True)), error)
        except RecordingError as problem:
            images = places[0] / "images"
            if not images.is_dir() or str(problem) != str(error):
                raise
            raise RecordingError(f"{problem}; to correct the images without exposures, give {images}") from None


def _expanded(path: Path) -> list[Path]:
    """Return the files that match a pattern; other paths, and those that exist, are returned unchanged."""
    if path.exists() or not glob.has_magic(str(path)):
        return [path]
    found = list(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    images = sorted((p for p in found if is_image_name(p.name)), key=lambda p: by_name(str(p)))
    if not images:
        why = next((why for p in found if (why := why_unread(p))), "check it, or give a folder")
        raise RecordingError(f"{path}: no image matches this pattern; {why}")
    return images


def _image_files(places: Sequence[Path], options: ReadingOptions) -> Source:
    """Open image files without exposures: it is unknown which list would belong to them."""
    for place in places:
        if not place.is_file():
            what = "is a folder; give only the folder, or only files" if place.is_dir() else "there is no such file"
            raise RecordingError(f"{place}: {what}")
        if not is_image_name(place.name):
            raise RecordingError(
                f"{place}: {why_unread(place) or 'is not an image; several files must all be images'}"
            )
    full = [place.absolute() for place in places]
    folder = Path(os.path.commonpath([place.parent for place in full]))
    names = tuple(dict.fromkeys(place.relative_to(folder).as_posix() for place in full))
    missing = ExposureError(
        f"{places[0]}: exposures of single files are unknown; give a folder with a list of exposures"
    )

    def no_list() -> FrameTable:
        raise missing

    images = open_sequence(
        folder, "images", FolderImages(folder, names), no_list, options=replace(options, unknown_exposures=True)
    )
    return Source(images, missing)
