"""The kinds of recordings and their recognition.

To add a kind, write a module in this package that ends with ``KIND = ...``, an object that implements :class:`Kind`,
and add its name to ``_MODULES`` below. The simplest example is :mod:`ospc.recording.tum_mono`. Its ``open`` usually
returns an :class:`~ospc.recording.image_sequence.ImageSequence` or a subclass of
:class:`~ospc.recording.recording.StoredRecording`. Options for the user are fields of
:class:`~ospc.recording.options.ReadingOptions`. A kind with several cameras also implements :class:`RigKind`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Protocol, runtime_checkable

from ospc.errors import RecordingError, SettingError, listed, os_error_as, path_of, quoted
from ospc.recording.image_source import why_unread
from ospc.recording.list_search import MOST_LOOKED_INTO, is_output, lists_in, only_image_folder
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.recording import Recording

_MODULES = ("tum_mono", "euroc", "exif_photos", "exposure_folders", "image_folder", "video", "rosbag")
"""Modules of this package with a ``KIND``; the first kind that recognises a path opens it."""

_IMAGES = "image_folder"
"""The kind of a folder of images whose list of exposures may be beside it."""

_EXPECTED = (
    "expected a folder with images/ or images.zip and times.txt (lines 'id stamp[s] exposure[ms]'), a folder of "
    "images with a list of their exposures or with EXIF, a EuRoC folder, folders named by exposure, a video file, "
    "or a ROS bag"
)

_VIDEOS_AND_BAGS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".bag", ".mcap", ".db3")
"""Suffixes of files that are recordings unless they are damaged."""


class Kind(Protocol):
    """One kind of recording: recognises and opens it."""

    @property
    def name(self) -> str:
        """Name for ``--kind``."""

    def recognises(self, path: Path) -> bool:
        """Return whether the path is of this kind, by a quick look at its content."""

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> Recording:
        """Open the path; RecordingError or ExposureError if it cannot be read as this kind."""


def kinds() -> Iterator[Kind]:
    """Yield the kinds in the order in which they are tried."""
    for module in _MODULES:
        kind: Kind = import_module(f"ospc.recording.{module}").KIND
        yield kind


def open_recording(path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT) -> Recording:
    """Open a recording.

    Parameters
    ----------
    path, kind
        Folder or file, and name of the kind; None to recognise it from the content. A folder that only contains one
        recording, such as a video with its list of exposures, stands for it.
    options
        Settings that are missing or wrong in the content, such as units, topics and the channel.

    Returns
    -------
    Recording
        The recording. Its frames are read one by one during iteration.

    Raises
    ------
    RecordingError
        If the path does not exist, is not of a known kind, or its parts do not match.
    SettingError
        If ``options`` are not of this type, or do not apply to this kind.
    """
    place = path_of(path, RecordingError, "a recording")
    if not isinstance(options, ReadingOptions):
        raise SettingError(f"options must be ReadingOptions, not {type(options).__name__}")
    with _readable(place):
        place, chosen = _located(place, kind)
    if chosen is None:
        # A stated kind opens any path, to say what it lacks.
        chosen = next((k for k in kinds() if k.name == kind), None)
    if chosen is not None:
        if chosen.name != "rosbag" and (stated := options.of_bags):
            raise SettingError(f"{place}: is not a ROS bag and has no topics; leave out {' and '.join(stated)}")
        try:
            with _readable(place):
                return chosen.open(place, options)
        except RecordingError:
            if not (place / "calibration.json").is_file():
                raise
            # Its pictures look like images of a recording, and its times.txt like a list of exposures.
            raise RecordingError(f"{place}: is a calibration; give a recording instead") from None
    if kind is not None:
        names = ", ".join(k.name for k in kinds())
        raise RecordingError(f"{quoted(str(kind))} is not a kind of recording; known: {names}")
    if files := [path.name for path in _entries(place)[:MOST_LOOKED_INTO] if path.is_file() and is_recording(path)]:
        raise RecordingError(f"{place}: is not a recording, but contains some; give one of them: {listed(files)}")
    if why := why_unread(place):
        raise RecordingError(f"{place}: {why}")
    problem, remedy = _nothing_known(place)
    raise RecordingError(f"{place}: {problem}", remedy)


def _entries(place: Path) -> list[Path]:
    """Return the files and then the folders in a folder."""
    return sorted(place.iterdir(), key=lambda path: (path.is_dir(), path)) if place.is_dir() else []


def is_recording(place: Path, kind: str | None = None) -> bool:
    """Return whether a path is of this kind, or of any kind; False if it cannot be read."""
    with suppress(OSError, RecordingError):
        return _recognising(place, kind) is not None
    return False


def _recognising(place: Path, kind: str | None) -> Kind | None:
    """Return the first kind that recognises a path, or the kind with this name if it does; otherwise None."""
    return next((k for k in kinds() if kind in (None, k.name) and k.recognises(place)), None)


def _nothing_known(place: Path) -> tuple[str, str]:
    """Return what is wrong with a path that is no recording, and the remedy."""
    if place.is_file() and place.suffix.lower() in _VIDEOS_AND_BAGS:
        damaged = "is damaged, or is not what its name says"
        return damaged if place.stat().st_size else "is an empty file", "copy or record it again"
    if place.is_dir():
        return "has no images" if any(place.iterdir()) else "the folder is empty", _EXPECTED
    return "a file of this kind is not a recording", _EXPECTED


@contextmanager
def _readable(place: Path) -> Iterator[None]:
    """Raise a RecordingError if a path does not exist, or cannot be read within the context."""
    with os_error_as(RecordingError, f"{place}: cannot be read", "check the path and its permissions"):
        if not place.exists():
            raise RecordingError(f"{place}: there is no such file or folder; check the path")
        yield


def _located(place: Path, kind: str | None) -> tuple[Path, Kind | None]:
    """Return the path, or that of the only recording in a folder that is not one itself, and the kind recognised."""
    found = _recognising(place, kind)
    if found is not None or not place.is_dir():
        return place, found
    entries = _entries(place)
    # If there are too many to look into, others cannot be excluded.
    inside = [path for path in entries if is_recording(path)] if len(entries) <= MOST_LOOKED_INTO else []
    inside = [path for path in inside if not is_output(path)]
    if len(inside) == 1 and inside[0].is_file() and (found := _recognising(inside[0], kind)):
        return inside[0], found
    # A folder with a list of exposures stands for the only folder of images in it.
    if kind in (None, _IMAGES) and lists_in(place) and (images := only_image_folder(place)):
        return images, _recognising(images, _IMAGES)
    return place, None


_MAX_CAMERAS = 64
"""Maximum number of cameras in a rig; a path with more is probably a collection of recordings."""

_MAX_NAME_CHARACTERS = 80
"""Maximum length of a camera name, which is also the name of a folder."""
_UNSAFE = re.compile(r"[^A-Za-z0-9_.-]+")


@runtime_checkable
class RigKind(Protocol):
    """A kind of recording that may have several cameras."""

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        """Return path and options to open each camera, by its name; RecordingError if that fails."""


def cameras_of(
    path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT
) -> dict[str, tuple[Path, ReadingOptions]]:
    """Return the path and the options with which :func:`open_recording` opens each camera of a rig, by its name.

    Cameras are opened separately, so that one without exposures does not affect the others. The parameters are those
    of :func:`~ospc.recording.kinds.open_recording`; a single camera counts as a rig of one. The names consist of
    letters, digits, ``_``, ``-`` and ``.``, and are valid folder names.

    Raises
    ------
    RecordingError
        If the path does not exist, or has too many cameras.
    """
    place = path_of(path, RecordingError, "a recording")
    with _readable(place):
        found = _cameras(place, kind, options)
    if len(found) > _MAX_CAMERAS:
        raise RecordingError(
            f"{place}: has {len(found)} cameras, more than the {_MAX_CAMERAS} allowed; open one of them"
        )
    named: dict[str, tuple[Path, ReadingOptions]] = {}
    for name, camera in found.items():
        safe, number = safe_name(name), 2
        while safe.lower() in map(str.lower, named):
            safe, number = f"{safe_name(name)}_{number}", number + 1
        named[safe] = camera
    return named


def _cameras(place: Path, kind: str | None, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
    place, chosen = _located(place, kind)
    single = {place.stem: (place, options)}
    if chosen is not None:
        return chosen.cameras(place, options) if isinstance(chosen, RigKind) else single
    inner = sorted(p for p in place.iterdir() if p.is_dir() and is_recording(p, kind)) if place.is_dir() else []
    inner = [path for path in inner if not is_output(path)]
    return {p.name: (p, options) for p in inner} or single


def safe_name(name: str, most: int = _MAX_NAME_CHARACTERS) -> str:
    """Return a name cut to ``most`` characters, with characters replaced that are not allowed in a folder name."""
    return _UNSAFE.sub("_", name).strip("._")[:most] or "camera"
