"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import re
import secrets
from contextlib import suppress
from pathlib import Path

_RANDOM_BITS = 64
"""Random part of an unfinished file's name, ``.<name>.<number>.part``: nobody can guess it and get there first."""

UNFINISHED = re.compile(r"\..+\.\d+\.part", re.DOTALL)
"""Names of unfinished files: a process that was killed leaves them behind."""

_PERMISSIONS = 0o666
"""What a file may be used for; the user's umask takes away from it, as for any new file."""


def write_atomically(path: str | Path, content: bytes, *, durable: bool = True) -> Path:
    """Write a file so that readers, and a crash at any moment, find the old content or the new, and return its path.

    If it is ``durable``, it outlives a power cut, too; that takes milliseconds. After an OSError nothing has changed.
    """
    place = Path(path)
    unfinished = place.with_name(f".{place.name}.{secrets.randbits(_RANDOM_BITS)}.part")
    # A new file or none: never one that is there, nor what a link points to. Windows has no such flag for links, but
    # O_EXCL does the same for the last part of a path.
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(unfinished, flags, _PERMISSIONS)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            if durable:
                # Without it, a power cut after the renaming may leave an empty file under the final name.
                os.fsync(stream.fileno())
        unfinished.replace(place)
    except BaseException:  # an interruption, too, must leave nothing behind
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        raise
    return place
