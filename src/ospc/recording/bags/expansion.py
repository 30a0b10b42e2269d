"""Decompression that stops as soon as more comes out than was stated."""

from __future__ import annotations

import bz2
import sys

from ospc.errors import RecordingError, needs_extra, quoted
from ospc.recording.bags.container import MAX_CHUNK_BYTES

ZSTD_START = b"\x28\xb5\x2f\xfd"
"""Magic number of a Zstandard frame (RFC 8878)."""


def expand(data: bytes, compression: str, size: int | None = None) -> bytes:
    """Decompress ``zstd``, ``lz4``, ``bz2``, or ``none``, to exactly ``size`` bytes if it is stated.

    Raises
    ------
    RecordingError
        If another number comes out, or more than :data:`~ospc.recording.bags.container.MAX_CHUNK_BYTES`, or the
        compression is unknown.
    MissingExtraError
        If the optional dependency for bags is not installed.
    """
    limit = MAX_CHUNK_BYTES if size is None else size
    if limit > MAX_CHUNK_BYTES:
        raise RecordingError(f"a chunk expands to more than the {MAX_CHUNK_BYTES} bytes allowed")
    if compression in ("", "none"):
        expanded = data
    elif compression in ("zstd", "lz4", "bz2"):
        expanded = _decompressor(compression).decompress(data, max_length=limit + 1)
    else:
        raise RecordingError(f"its compression {quoted(compression)} is unknown")
    if len(expanded) > limit or (size is not None and len(expanded) != size):
        raise RecordingError("a chunk does not expand to its stated size")
    return bytes(expanded)


def _decompressor(compression: str) -> bz2.BZ2Decompressor:
    """Return an incremental decompressor; all have the interface of that in bz2."""
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    with needs_extra("reading compressed bags", "ros"):
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor as Decompressor
        elif sys.version_info >= (3, 14):
            from compression.zstd import ZstdDecompressor as Decompressor
        else:
            from backports.zstd import ZstdDecompressor as Decompressor
    decompressor: bz2.BZ2Decompressor = Decompressor()
    return decompressor
