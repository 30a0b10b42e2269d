"""Recordings in object stores: find them by pattern, and copy them to this machine for reading."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from ospc.errors import RecordingError, message_of, needs_extra

_PROTOCOLS = (
    *("abfs", "abfss", "adl", "az", "file", "ftp", "gcs", "gs", "hdfs", "http", "https", "local", "memory"),
    *("oci", "oss", "s3", "s3a", "sftp", "ssh", "webdav", "webhdfs"),
)
"""fsspec protocols that store files; others (archives, caches, other programs) are not allowed in a manifest."""

_MOST_BYTES = 500 * 10**9
_MOST_FILES = 2_000_000
"""Size limits of a recording, far above any real one, so that a wrong address does not fill the disk."""

_LONGEST_REASON = 200
"""Most characters kept of a store's error message."""

_URL = re.compile(r"[a-z][a-z0-9+.-]*://")


def matches(pattern: str) -> list[str]:
    """Return the addresses that match a pattern."""
    store, root = _store(pattern)
    with _one_error(pattern):
        return sorted(store.unstrip_protocol(name) for name in store.glob(root))


def is_address(text: str) -> bool:
    """Return whether a text is an object-store address rather than a path."""
    return _URL.match(text) is not None


@contextmanager
def local_copy(address: str) -> Iterator[Path]:
    """Yield the local path of a recording; one in an object store is copied to a temporary folder first."""
    if not is_address(address):
        yield Path(address)
        return
    store, root = _store(address)
    top = PurePosixPath(root.rstrip("/"))
    with tempfile.TemporaryDirectory(prefix="ospc-") as folder:
        place = Path(folder) / (top.name or "recording")
        with _one_error(address):
            files = store.find(root, detail=True)
            if not files:
                raise RecordingError(f"{address}: there is no such file or folder; check the address")
            size = sum(int(detail.get("size") or 0) for detail in files.values())
            if len(files) > _MOST_FILES or size > _MOST_BYTES:
                raise RecordingError(f"{address}: {len(files)} files, {size} bytes in total, are too much to copy")
            for source in files:
                target = place.joinpath(*_parts_below(top, source, address))
                target.parent.mkdir(parents=True, exist_ok=True)
                store.get_file(source, str(target))
        yield place


def _store(address: str) -> tuple[Any, str]:
    """Return fsspec's file system for an address, and the path in it."""
    protocol = address.split("://", 1)[0]
    if protocol not in _PROTOCOLS or "::" in address:
        raise RecordingError(f"{address}: unknown object store {protocol}; known are {', '.join(_PROTOCOLS)}")
    with needs_extra("reading from object stores", "objects"):
        from fsspec.core import url_to_fs
    with _one_error(address):
        store, root = url_to_fs(address)
    return store, str(root)


@contextmanager
def _one_error(address: str) -> Iterator[None]:
    """Convert the errors of the various stores to RecordingError."""
    try:
        yield
    except RecordingError:
        raise
    except ImportError as error:
        raise RecordingError(f"{address}: needs another package ({error})") from None
    except Exception as error:
        reason = message_of(error, _LONGEST_REASON)
        raise RecordingError(f"{address}: cannot be read ({type(error).__name__}: {reason})") from None


def _parts_below(top: PurePosixPath, source: str, address: str) -> tuple[str, ...]:
    """Return the parts of a file's path below the recording; none if the recording is that file."""
    parts = PurePosixPath(source).parts
    below = parts[len(top.parts) :] if parts[: len(top.parts)] == top.parts else parts[-1:]
    for name in below:
        if name in ("", ".", "..") or set(name) & set("/\\\0"):
            raise RecordingError(f"{address}: contains a file whose name {name!r} leads out of the recording")
    return below
