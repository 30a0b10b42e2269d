"""Recordings of several cameras: a EuRoC folder, a bag, or folders side by side."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

from ospc.errors import RecordingError
from ospc.recording.kinds import kinds, open_recording
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.recording import Recording

_MAX_CAMERAS = 64
"""Rigs with more cameras are refused; the path is probably a collection of recordings."""

_MAX_NAME_CHARACTERS = 80
"""Length of the name of a camera, which names a folder."""
_UNSAFE = re.compile(r"[^A-Za-z0-9_.-]+")

Opener = Callable[[], Recording]
"""Opens the recording of one camera."""


@runtime_checkable
class RigKind(Protocol):
    """A kind of recording that may hold several cameras."""

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        """Return the path and the options that open each camera, by its name; RecordingError if that fails."""
        ...


def cameras_of(path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT) -> dict[str, Opener]:
    """Return a function for each camera of a rig that opens its recording, by the name of the camera.

    Cameras are opened one by one, so that the others can be read if one has no exposures.

    Parameters
    ----------
    path
        Folder or file; a single camera counts as a rig of one.
    kind, options
        As for :func:`~ospc.recording.kinds.open_recording`.

    Returns
    -------
    dict[str, Opener]
        The names consist of letters, digits, ``_``, ``-`` and ``.``, and are valid names of folders.

    Raises
    ------
    RecordingError
        If there is nothing at the path, or it holds too many cameras.
    """
    place = Path(path)
    if not place.exists():
        raise RecordingError(f"{place}: there is no such file or folder; check the path")
    found = _cameras(place, kind, options)
    if len(found) > _MAX_CAMERAS:
        raise RecordingError(
            f"{place}: holds {len(found)} cameras, more than the {_MAX_CAMERAS} allowed; open one of them"
        )
    openers: dict[str, Opener] = {}
    taken: set[str] = set()
    for name, (camera, of_camera) in found.items():
        safe, number = safe_name(name), 2
        while safe.lower() in taken:
            safe, number = f"{safe_name(name)}_{number}", number + 1
        taken.add(safe.lower())
        openers[safe] = partial(open_recording, camera, kind, of_camera)
    return openers


def _cameras(place: Path, kind: str | None, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
    chosen = next((k for k in kinds() if (k.recognises(place) if kind is None else k.name == kind)), None)
    single = {place.stem: (place, options)}
    if chosen is not None and chosen.recognises(place):
        return chosen.cameras(place, options) if isinstance(chosen, RigKind) else single
    inner = sorted(p for p in place.iterdir() if p.is_dir()) if place.is_dir() else []
    recordings = [p for p in inner if any(k.recognises(p) for k in kinds() if kind in (None, k.name))]
    return {p.name: (p, options) for p in recordings} or single


def safe_name(name: str) -> str:
    """Return the name with everything replaced that does not fit a folder name."""
    return _UNSAFE.sub("_", name).strip("._")[:_MAX_NAME_CHARACTERS] or "camera"
