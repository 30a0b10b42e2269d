"""The kinds of recordings, and how one is recognised."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Protocol

from ospc.errors import RecordingError
from ospc.recording.recording import Recording

_MODULES = ("tum_mono",)
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

    def open(self, path: Path) -> Recording:
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


def open_recording(path: str | Path, kind: str | None = None) -> Recording:
    """Open a recording; its kind is recognised from its content unless given.

    Parameters
    ----------
    path
        Folder or file.
    kind
        Name of the kind, to override the recognition.

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
    if not place.exists():
        raise RecordingError(f"{place}: there is no such file or folder; check the path")
    known = list(kinds())
    if kind is not None:
        chosen = next((k for k in known if k.name == kind), None)
        if chosen is None:
            raise RecordingError(
                f"no kind of recording is called '{kind}'; known: {', '.join(k.name for k in known)}"
            )
        return chosen.open(place)
    for candidate in known:
        if candidate.recognises(place):
            return candidate.open(place)
    raise RecordingError(
        f"{place}: not recognised as a recording; expected a folder with images/ or images.zip and times.txt "
        f"(lines 'id stamp[s] exposure[ms]'), or a folder of images with a file of exposures"
    )
