"""Recordings in object stores: found by patterns, and copied to this machine while they are read."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from ospc.errors import MissingExtraError, RecordingError, said_by

_PROTOCOLS = (
    *("abfs", "abfss", "adl", "az", "file", "ftp", "gcs", "gs", "hdfs", "http", "https", "local", "memory"),
    *("oci", "oss", "s3", "s3a", "sftp", "ssh", "webdav", "webhdfs"),
)
_MOST_BYTES = 500 * 10**9
_MOST_FILES = 2_000_000


def matches(pattern: str) -> list[str]:
    """Return the addresses that match a pattern.

    Raises
    ------
    RecordingError
        If the store cannot be reached, or its protocol is none that is known.
    MissingExtraError
        Without fsspec.
    """
    store, root = _store(pattern)
    try:
        found = store.glob(root)
        return sorted(store.unstrip_protocol(name) for name in found)
    except Exception as error:  # each store raises errors of its own
        raise _unreachable(pattern, error) from None


@contextmanager
def local_copy(address: str) -> Iterator[Path]:
    """Give a copy of a recording on this machine, removed afterwards.

    Raises
    ------
    RecordingError
        If it cannot be copied.
    MissingExtraError
        Without fsspec.
    """
    store, root = _store(address)
    name = PurePosixPath(root.rstrip("/")).name or "recording"
    with tempfile.TemporaryDirectory(prefix="ospc-") as folder:
        place = Path(folder) / _safe(name, address)
        try:
            files = store.find(root, detail=True)
        except Exception as error:
            raise _unreachable(address, error) from None
        if not files:
            raise RecordingError(f"{address}: there is no such file or folder; check the address")
        _check_amount(address, files)
        for source in files:
            target = place.joinpath(*(_safe(part, address) for part in _below(source, root)))
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                store.get_file(source, str(target))
            except Exception as error:
                raise _unreachable(source, error) from None
        yield place


def _store(address: str) -> tuple[Any, str]:
    protocol = address.split("://", 1)[0]
    if protocol not in _PROTOCOLS or "::" in address:
        raise RecordingError(f"{address}: {protocol} is no object store that is known; {', '.join(_PROTOCOLS)} are")
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise MissingExtraError("reading from object stores", "objects") from None
    try:
        store, root = url_to_fs(address)
    except ImportError as error:
        raise RecordingError(f"{address}: {protocol} needs another package ({error})") from None
    except Exception as error:
        raise _unreachable(address, error) from None
    return store, str(root)


def _below(source: str, root: str) -> tuple[str, ...]:
    """Return the path of a file below a recording's; nothing where the recording is that file."""
    here, top = PurePosixPath(source).parts, PurePosixPath(root.rstrip("/")).parts
    return here[len(top) :] if here[: len(top)] == top else here[-1:]


def _safe(name: str, address: str) -> str:
    if name in ("", ".", "..") or "/" in name or "\\" in name or "\0" in name:
        raise RecordingError(f"{address}: holds a file whose name {name!r} leads out of the recording")
    return name


def _check_amount(address: str, files: dict[str, Any]) -> None:
    size = sum(int(detail.get("size") or 0) for detail in files.values())
    if len(files) > _MOST_FILES or size > _MOST_BYTES:
        raise RecordingError(f"{address}: {len(files)} files of {size} bytes are too many for one recording")


def _unreachable(address: str, error: Exception) -> RecordingError:
    if isinstance(error, RecordingError):
        return error
    text = said_by(error, 200)
    return RecordingError(f"{address}: cannot be read ({type(error).__name__}: {text})")
