"""Atomic writing of files."""

from __future__ import annotations

import os
import re
import secrets
from contextlib import suppress
from pathlib import Path

_RANDOM_BITS = 64
"""Random bits in the name of an unfinished file, ``.<name>.<number>.part``, so that nobody can guess the name and
create the file first."""

UNFINISHED = re.compile(r"\..+\.\d+\.part", re.DOTALL)
"""Names of unfinished files, which a killed process leaves behind."""

_PERMISSIONS = 0o666
"""Permissions before the user's umask, as for any new file."""


def write_atomically(path: str | Path, content: bytes, *, durable: bool = True) -> Path:
    """Write a file atomically and return its path: readers find the old or the new content, even after a crash.

    If ``durable``, the content also survives a power cut; this takes milliseconds. After an OSError, nothing has
    changed.
    """
    place = Path(path)
    unfinished = place.with_name(f".{place.name}.{secrets.randbits(_RANDOM_BITS)}.part")
    # Never open an existing file or follow a link. Windows has no O_NOFOLLOW, but O_EXCL also rejects links.
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(unfinished, flags, _PERMISSIONS)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            if durable:
                # Otherwise a power cut after the renaming could leave an empty file under the final name.
                os.fsync(stream.fileno())
        unfinished.replace(place)
    except BaseException:  # including interruptions
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        raise
    return place
