"""Output folders: made before the work begins, and written to by one process at a time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from ospc.atomic import UNFINISHED
from ospc.errors import SettingError, os_error_as

try:
    import fcntl
except ImportError:  # Windows has no such locks; there, nothing keeps a second process out
    fcntl = None  # type: ignore[assignment]


def check_usable(
    place: Path, recording: Path | None = None, check_content: Callable[[Path], None] = lambda _place: None
) -> None:
    """Refuse what cannot be, or become, a folder to write to, before anything is changed.

    SettingError if it is a file, a link to nothing, not writable, or the folder of the recording itself or of its
    images. ``check_content`` is asked about a folder that is there, and may refuse it.
    """
    with os_error_as(SettingError, f"{place}: cannot be used for output", "choose another folder"):
        if recording is not None and _holds(recording.resolve(), place.resolve()):
            raise SettingError(f"{place}: holds the recording itself; choose another folder for the output")
        if place.is_symlink() and not place.exists():
            raise SettingError(f"{place}: is a link to nothing ({place.readlink()}); choose another folder")
        if place.exists() and not place.is_dir():
            raise SettingError(f"{place}: is a file; name a folder for the output")
        nearest = next(folder for folder in (place, *place.absolute().parents) if folder.exists())
        if nearest == place:
            check_content(place)
    if not (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        why = "is not writable" if nearest == place else f"cannot be made: {nearest} is not writable"
        raise SettingError(f"{place}: {why}; choose another folder")


def _holds(recording: Path, place: Path) -> bool:
    """Return whether a folder holds files of the recording: its own folder, its images, or the folder of a video."""
    return place in (recording, (recording / "images").resolve()) or (
        recording.is_file() and place == recording.parent
    )


@contextmanager
def reserved(folder: str | Path) -> Iterator[Path]:
    """Make a folder and keep other processes that reserve it out.

    The lock is on the folder itself: it leaves no file behind, and ends with the process, however that ends. A folder
    that was made here and is still empty at the end is removed again. Unfinished files of processes that were killed
    are removed. SettingError if it cannot be made or written to, or somebody else has reserved it.
    """
    place = Path(folder)
    check_usable(place)
    made = [path for path in (place, *place.parents) if not path.exists()]
    with os_error_as(SettingError, f"{place}: cannot be made", "choose another folder"):
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
    """Remove the unfinished files in a locked folder, and in those below that nobody else has locked."""
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
            f"{place}: another process is writing into it; wait until it has finished, or choose another folder"
        ) from None
    except OSError:
        pass  # some network file systems have no locks
    try:
        yield
    finally:
        os.close(descriptor)
