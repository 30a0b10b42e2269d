"""Names of image files and their order."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm"})
"""Suffixes of image files, in lower case."""


def is_image_name(name: str) -> bool:
    """Tell whether a file name is that of an image; hidden files are not."""
    return PurePosixPath(name).suffix.lower() in IMAGE_SUFFIXES and not name.startswith(".")


def by_name(name: str) -> tuple[tuple[object, ...], str]:
    """Return a sorting key in which 2 comes before 10, with and without leading zeros."""
    parts = re.split(r"(\d+)", name)
    return tuple(_as_number(part) if i % 2 else part for i, part in enumerate(parts)), name


def _as_number(digits: str) -> tuple[int, str]:
    # Compared by length and then as text: hostile names may have more digits than Python converts.
    significant = digits.lstrip("0")
    return len(significant), significant
