"""Recordings of several cameras at once: those of a EuRoC folder, of a bag, or of folders side by side."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol, runtime_checkable

from ospc.errors import RecordingError
from ospc.recording.kinds import kinds, open_recording
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.recording import Recording

_MAX_CAMERAS = 64
_UNSAFE = re.compile(r"[^A-Za-z0-9_.-]+")

Opener = Callable[[], Recording]
"""Opens the recording of one camera."""


@runtime_checkable
class RigKind(Protocol):
    """A kind of recording that may hold several cameras."""

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        """Return for each camera what to open it with, by its name.

        Raises
        ------
        RecordingError
            If the path cannot be read.
        """
        ...


def cameras_of(path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT) -> dict[str, Opener]:
    """Return what opens the recording of each camera of a rig, by the name of the camera.

    Cameras are opened one by one, so that one without exposures does not keep the others from being read.

    Parameters
    ----------
    path
        Folder or file; that of a single camera is a rig of one.
    kind
        Name of the kind of the recordings, to override the recognition.
    options
        What their content does not say.

    Returns
    -------
    dict[str, Opener]
        Names hold letters, digits, ``_``, ``-`` and ``.`` only, and can name a folder.

    Raises
    ------
    RecordingError
        If there is nothing at the path, or it holds too many cameras.
    """
    place = Path(path)
    if not place.exists():
        raise RecordingError(f"{place}: there is no such file or folder; check the path")
    found = dict(_parts(place, kind, options))
    if len(found) > _MAX_CAMERAS:
        raise RecordingError(f"{place}: holds {len(found)} cameras, more than the {_MAX_CAMERAS} allowed")
    return {name: _opener(part, kind, of_part) for name, (part, of_part) in found.items()}


def _opener(path: Path, kind: str | None, options: ReadingOptions) -> Opener:
    return lambda: open_recording(path, kind, options)


def _parts(
    place: Path, kind: str | None, options: ReadingOptions
) -> Iterator[tuple[str, tuple[Path, ReadingOptions]]]:
    chosen = next((k for k in kinds() if (k.recognises(place) if kind is None else k.name == kind)), None)
    if isinstance(chosen, RigKind) and chosen.recognises(place):
        yield from _named(chosen.cameras(place, options))
    elif chosen is not None and chosen.recognises(place):
        yield safe_name(place.stem), (place, options)
    else:
        inner = sorted(p for p in place.iterdir() if p.is_dir()) if place.is_dir() else []
        recordings = [p for p in inner if any(k.recognises(p) for k in kinds() if kind in (None, k.name))]
        yield from _named({p.name: (p, options) for p in recordings} or {place.stem: (place, options)})


def _named(
    cameras: dict[str, tuple[Path, ReadingOptions]],
) -> Iterator[tuple[str, tuple[Path, ReadingOptions]]]:
    """Make names safe, and still different."""
    taken: set[str] = set()
    for name, part in cameras.items():
        safe, number = safe_name(name), 2
        while safe.lower() in taken:
            safe, number = f"{safe_name(name)}_{number}", number + 1
        taken.add(safe.lower())
        yield safe, part


def safe_name(name: str) -> str:
    """Return a name that can be that of a folder, of at most 80 characters."""
    return _UNSAFE.sub("_", name).strip("._")[:80] or "camera"
