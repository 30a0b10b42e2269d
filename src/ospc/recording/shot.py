"""How a photograph was taken, from its EXIF."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from io import BytesIO
from typing import Any

from ospc.errors import needs_extra

_TIME, _NUMBER, _ISO = "EXIF ExposureTime", "EXIF FNumber", "EXIF ISOSpeedRatings"
_TAKEN, _FRACTION, _MODEL = "EXIF DateTimeOriginal", "EXIF SubSecTimeOriginal", "Image Model"

_MOST_BYTES = 8 * 2**20
"""Read of the EXIF of one photograph, some bytes again and again: far more than cameras write."""

_READ_COST_BYTES = 512
"""Bytes that a read counts at least, so that the number of reads is limited too."""


@dataclass(frozen=True)
class Shot:
    """How a photograph was taken; None for what its file does not state.

    Attributes
    ----------
    time_s
        Exposure time in seconds.
    iso, f_number
        ISO speed and f-number.
    taken
        When it was taken.
    model
        Name of the camera, empty if it is unknown.
    """

    time_s: float | None = None
    iso: float | None = None
    f_number: float | None = None
    taken: datetime | None = None
    model: str = ""


def shot_of_exif(data: bytes) -> Shot:
    """Read the EXIF of a file, or of its beginning; damaged EXIF states nothing."""
    tags = _tags(data)
    time_s, iso, f_number = (_positive(tags, name) for name in (_TIME, _ISO, _NUMBER))
    return Shot(time_s, iso, f_number, _taken(tags), str(tags.get(_MODEL, "")))


def _tags(data: bytes) -> Mapping[str, Any]:
    with needs_extra("reading exposures from photographs", "exif"):
        import exifread
    logger = logging.getLogger("exifread")
    if not logger.handlers:
        # Without a handler, its remarks on odd files would be printed.
        logger.addHandler(logging.NullHandler())
    try:
        tags: Mapping[str, Any] = exifread.process_file(_BoundedReads(data), details=False)
    except Exception:
        # The parser raises undocumented errors for damaged EXIF.
        return {}
    return tags


class _BoundedReads(BytesIO):
    """Ends reading by an error where the directories of hostile EXIF overlap, which would take hours."""

    _left = _MOST_BYTES

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size)
        self._left -= max(len(found), _READ_COST_BYTES)
        if self._left < 0:
            raise ValueError("too many reads")
        return found


def _positive(tags: Mapping[str, Any], name: str) -> float | None:
    """Return the number in a tag, None if it is absent or not positive."""
    try:
        value = float(tags[name].values[0])
    except (KeyError, IndexError, AttributeError, TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return value if math.isfinite(value) and value > 0 else None


def _taken(tags: Mapping[str, Any]) -> datetime | None:
    digits = str(tags.get(_FRACTION, "0")).strip()[:6]
    fraction = digits if digits.isascii() and digits.isdigit() else "0"
    try:
        return datetime.strptime(f"{tags[_TAKEN]}.{fraction}", "%Y:%m:%d %H:%M:%S.%f")
    except (KeyError, ValueError):
        return None
