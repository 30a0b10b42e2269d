"""Files that are there whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def write_atomically(path: str | Path, content: bytes) -> Path:
    """Write a file so that readers, and a crash at any moment, find the old content or the new, and return its path.

    Parameters
    ----------
    path
        Where to; its folder must exist.
    content
        All of the file.

    Raises
    ------
    OSError
        If it cannot be written; nothing has changed then.
    """
    place = Path(path)
    unfinished = place.with_name(f".{place.name}.{os.getpid()}.part")
    try:
        with unfinished.open("wb") as stream:
            stream.write(content)
            stream.flush()
            # Without it, a power cut after the renaming may leave an empty file under the final name.
            os.fsync(stream.fileno())
        unfinished.replace(place)
    except BaseException:  # an interruption, too, must leave nothing behind
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        raise
    return place
