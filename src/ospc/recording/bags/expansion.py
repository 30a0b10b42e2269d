"""Decompression that stops where more comes out than was stated, whatever the compressed data hold."""

from __future__ import annotations

import bz2
import sys

from ospc.errors import MissingExtraError, RecordingError
from ospc.recording.bags.container import MAX_CHUNK_BYTES
from ospc.recording.wording import quoted

ZSTD_START = b"\x28\xb5\x2f\xfd"


def expand(data: bytes, compression: str, size: int | None = None) -> bytes:
    """Decompress.

    Parameters
    ----------
    data
        What to decompress.
    compression
        ``zstd``, ``lz4``, ``bz2``, or ``none``.
    size
        Number of bytes that must come out, where it is stated.

    Raises
    ------
    RecordingError
        If more or less comes out, or more than :data:`~ospc.recording.bags.container.MAX_CHUNK_BYTES`, or the
        compression is unknown.
    """
    limit = MAX_CHUNK_BYTES if size is None else size
    if limit > MAX_CHUNK_BYTES:
        raise RecordingError(f"a chunk expands to more than the {MAX_CHUNK_BYTES} bytes allowed")
    if compression in ("", "none"):
        expanded = data
    elif compression == "zstd":
        expanded = _zstd(data, limit + 1)
    elif compression == "lz4":
        expanded = _lz4(data, limit + 1)
    elif compression == "bz2":
        expanded = bz2.BZ2Decompressor().decompress(data, max_length=limit + 1)
    else:
        raise RecordingError(f"its compression {quoted(compression)} is unknown")
    if len(expanded) > limit or (size is not None and len(expanded) != size):
        raise RecordingError("a chunk does not expand to the size that is stated for it")
    return expanded


def _lz4(data: bytes, limit: int) -> bytes:
    try:
        from lz4.frame import LZ4FrameDecompressor
    except ImportError:
        raise MissingExtraError("reading compressed bags", "ros") from None
    return bytes(LZ4FrameDecompressor().decompress(data, max_length=limit))


def _zstd(data: bytes, limit: int) -> bytes:
    try:
        if sys.version_info >= (3, 14):
            from compression import zstd
        else:
            from backports import zstd
    except ImportError:
        raise MissingExtraError("reading compressed bags", "ros") from None
    return bytes(zstd.ZstdDecompressor().decompress(data, max_length=limit))
