"""The kinds of recordings, and how they are recognised.

To add a kind, write one module in this package and add its name to ``_MODULES`` below. The module ends with
``KIND = ...``, an object that satisfies :class:`Kind`; the simplest example is :mod:`ospc.recording.tum_mono`. Its
``open`` usually returns an :class:`~ospc.recording.image_sequence.ImageSequence` or a subclass of
:class:`~ospc.recording.recording.StoredRecording`. Options that the user must state are fields of
:class:`~ospc.recording.options.ReadingOptions`. If a path can hold several cameras, the kind also has the method of
:class:`~ospc.recording.rig.RigKind`.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Protocol

from ospc.errors import RecordingError, quoted
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.recording import Recording
from ospc.recording.unread import why_unread

_MODULES = ("tum_mono", "euroc", "exif_photos", "exposure_folders", "image_folder", "video", "rosbag")
"""Modules of this package with a ``KIND``; the first kind that recognises a path opens it."""

_EXPECTED = (
    "expected a folder with images/ or images.zip and times.txt (lines 'id stamp[s] exposure[ms]'), a folder of "
    "images with a list of their exposures or with EXIF, a EuRoC folder, folders named by exposure, a video file, "
    "or a ROS bag"
)


class Kind(Protocol):
    """One kind of recording: recognises and opens it."""

    @property
    def name(self) -> str:
        """Name as ``--kind`` takes it."""
        ...

    def recognises(self, path: Path) -> bool:
        """Tell from the content, quickly, whether the path is of this kind."""
        ...

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> Recording:
        """Open the path; RecordingError, or ExposureError, if it cannot be read as this kind."""
        ...


def kinds() -> Iterator[Kind]:
    """Yield the kinds in the order in which they are tried."""
    for module in _MODULES:
        kind: Kind = import_module(f"ospc.recording.{module}").KIND
        yield kind


def open_recording(path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT) -> Recording:
    """Open a recording.

    Parameters
    ----------
    path
        Folder or file.
    kind
        Name of the kind; None to recognise it from the content.
    options
        What the content does not state, or states wrongly: units, topics, channel.

    Returns
    -------
    Recording
        Its frames are read one by one when it is iterated over.

    Raises
    ------
    RecordingError
        If the path does not exist, is of no known kind, or its parts do not match.
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
        try:
            return chosen.open(place, options)
        except RecordingError:
            if not (place / "calibration.json").is_file():
                raise
            # Its pictures look like images, and its times.txt like a list of exposures.
            raise RecordingError(f"{place}: is a calibration; name a recording in its place") from None
    if kind is not None:
        names = ", ".join(k.name for k in known)
        raise RecordingError(f"{quoted(kind)} is not a kind of recording; known: {names}")
    raise RecordingError(f"{place}: {why_unread(place) or f'{_reason(place)}; {_EXPECTED}'}")


def _reason(place: Path) -> str:
    """Say why no kind recognised the path."""
    if not place.is_dir():
        return "a file of this kind is not a recording"
    return "holds no images" if any(place.iterdir()) else "the folder is empty"
