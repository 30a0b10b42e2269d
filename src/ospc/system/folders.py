"""Output folders: created before work begins, and used by one process at a time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ospc.errors import SettingError, os_error_as
from ospc.system.atomic import UNFINISHED

try:
    import fcntl
except ImportError:  # Windows has no such locks, so a second process is not kept out
    fcntl = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Content:
    """What an output folder contains, and when new output may be written to it nevertheless.

    ``earlier_output`` is whether it is the output of an earlier run, even if that is only replaced with force.
    """

    description: str
    allowed: Literal["always", "with force", "never"]
    earlier_output: bool = False


NOT_EMPTY = Content("is not an empty folder", "never")


def check_usable(
    place: Path,
    recording: Path | None = None,
    content_of: Callable[[Path], Content] = lambda _place: Content("", "always"),
    *,
    force: bool = False,
) -> None:
    """Check that a path can be used as an output folder, without changing anything.

    ``content_of`` is called with a folder that is not empty. Inside the folder of the recording, ``force`` only
    replaces earlier output, because other files may be part of the recording.

    Raises
    ------
    SettingError
        If the path is a file, a broken link, not writable, the folder of the recording or of its images or a folder
        around these, or if its content does not allow new output.
    """
    with os_error_as(SettingError, f"{place}: cannot be used for output", "choose another folder"):
        if recording is not None and _holds(recording.resolve(), place.resolve()):
            raise SettingError(f"{place}: contains the recording itself; choose another folder for the output")
        if place.is_symlink() and not place.exists():
            raise SettingError(f"{place}: is a broken link (to {place.readlink()}); choose another folder")
        if place.exists() and not place.is_dir():
            raise SettingError(f"{place}: is a file; choose a folder for the output")
        nearest = next(folder for folder in (place, *place.absolute().parents) if folder.exists())
        if nearest == place and any(place.iterdir()):
            content = content_of(place)
            inside = recording is not None and recording.resolve() in place.resolve().parents
            if inside and content.allowed != "always" and not content.earlier_output:
                content = Content("is inside the recording and may contain a part of it", "never")
            if content.allowed == "never":
                raise SettingError(f"{place}: {content.description}; choose another folder")
            if content.allowed == "with force" and not force:
                raise SettingError(f"{place}: {content.description}; choose another folder, or force writing to it")
    if not (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        why = "is not writable" if nearest == place else f"cannot be created: {nearest} is not writable"
        raise SettingError(f"{place}: {why}; choose another folder")


def check_new(files: Iterable[Path], *, force: bool) -> None:
    """Refuse to replace files that exist, unless forced; SettingError."""
    for place in files:
        if not force and place.exists():
            raise SettingError(f"{place}: exists already; choose another name, or force its replacement")


def _holds(recording: Path, place: Path) -> bool:
    """Return whether a folder is that of the recording or of its images, or contains it, perhaps with its lists."""
    return place in (recording, (recording / "images").resolve(), *recording.parents)


def writing(place: Path) -> AbstractContextManager[None]:
    """Turn an OSError into a SettingError that a file or folder cannot be written."""
    return os_error_as(SettingError, f"{place}: cannot be written", "choose another folder")


@contextmanager
def reserved(folder: str | Path) -> Iterator[Path]:
    """Create a folder and lock it against other processes that reserve it.

    The lock is on the folder itself. It needs no file, and is released when the process ends for any reason. Files
    left unfinished by killed processes are removed, and so is a new folder if it is still empty at the end.

    Raises
    ------
    SettingError
        If the folder cannot be created or written to, or another process has reserved it.
    """
    place = Path(folder)
    check_usable(place)
    made = [path for path in (place, *place.parents) if not path.exists()]
    with os_error_as(SettingError, f"{place}: cannot be created", "choose another folder"):
        place.mkdir(parents=True, exist_ok=True)
    try:
        with _locked(place):
            _remove_unfinished(place)
            yield place
    finally:
        with suppress(OSError):
            for path in made:
                path.rmdir()


def _remove_unfinished(place: Path) -> None:
    """Remove the unfinished files in a locked folder, and in its subfolders that no other process has locked."""
    if fcntl is None:
        return
    for path in place.rglob(".*.part"):
        if UNFINISHED.fullmatch(path.name):
            with suppress(OSError, SettingError), nullcontext() if path.parent == place else _locked(path.parent):
                path.unlink()


@contextmanager
def _locked(place: Path) -> Iterator[None]:
    if fcntl is None:
        yield
        return
    descriptor = os.open(place, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise SettingError(
            f"{place}: another process is writing to it; wait until it has finished, or choose another folder"
        ) from None
    except OSError:
        pass  # some network file systems have no locks
    try:
        yield
    finally:
        os.close(descriptor)
