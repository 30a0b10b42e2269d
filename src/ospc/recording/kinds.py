"""The kinds of recordings, and how one is recognised."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Protocol

from ospc.errors import RecordingError
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.recording import Recording
from ospc.recording.wording import quoted

_MODULES = ("tum_mono", "euroc", "exif_photos", "exposure_folders", "image_folder", "video", "rosbag")
"""Modules of this package, in the order in which they are asked; each has a ``KIND``."""


class Kind(Protocol):
    """One kind of recording: recognises it and opens it."""

    @property
    def name(self) -> str:
        """Name as ``--kind`` takes it."""
        ...

    def recognises(self, path: Path) -> bool:
        """Tell from the content, cheaply, whether the path is of this kind."""
        ...

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> Recording:
        """Open the path.

        Raises
        ------
        RecordingError
            If it cannot be read as this kind.
        """
        ...


def kinds() -> Iterator[Kind]:
    """Give the known kinds in the order in which they are asked."""
    for module in _MODULES:
        kind: Kind = import_module(f"ospc.recording.{module}").KIND
        yield kind


def open_recording(path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT) -> Recording:
    """Open a recording; its kind is recognised from its content unless given.

    Parameters
    ----------
    path
        Folder or file.
    kind
        Name of the kind, to override the recognition.
    options
        What its content does not say, or says wrongly: units, topics, channel.

    Returns
    -------
    Recording
        Frames are read one by one when it is iterated over.

    Raises
    ------
    RecordingError
        If there is nothing at the path, or it is of no known kind, or its parts do not belong together.
    """
    place = Path(path)
    known = list(kinds())
    try:
        if not place.exists():
            raise RecordingError(f"{place}: there is no such file or folder; check the path")
        if kind is None:
            chosen = next((k for k in known if k.recognises(place)), None)
        else:
            chosen = next((k for k in known if k.name == kind), None)
    except OSError as error:
        raise RecordingError(f"{place}: cannot be read ({error.strerror}); check the path and its rights") from None
    if chosen is not None:
        return chosen.open(place, options)
    if kind is not None:
        names = ", ".join(k.name for k in known)
        raise RecordingError(f"no kind of recording is called {quoted(kind)}; known: {names}")
    raise RecordingError(f"{place}: {_reason(place)}; {_EXPECTED}")


_EXPECTED = (
    "expected a folder with images/ or images.zip and times.txt (lines 'id stamp[s] exposure[ms]'), a folder of "
    "images with a list of their exposures or with EXIF, a EuRoC folder, folders named by exposure, a video file, "
    "or a ROS bag"
)


def _reason(place: Path) -> str:
    """Say why nothing recognised the path."""
    if not place.is_dir():
        return "a file of this kind is not a recording"
    return "holds no images" if any(place.iterdir()) else "the folder is empty"
