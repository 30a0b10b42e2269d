"""Images whose pixels lie behind red, green and blue filters: how to tell, and what to take of them as grey."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np

from ospc.arrays import Image
from ospc.errors import SettingError

_MOSAIC_RATIO = 0.7
"""Measured: 0.31–0.45 on a real mosaic, 1.15 on grey images of the same camera and of others."""

_LOOKED_AT = 1024
"""Width and height of the part in the middle that decides; even, so that blocks stay whole."""


class GreenPixels(Enum):
    """Which pixels of each 2×2 block are green: those of the falling diagonal or of the rising one."""

    FALLING = ((0, 0), (1, 1))
    RISING = ((0, 1), (1, 0))

    def of(self, image: Image) -> Image:
        """Return the mean of the two green pixels of each block, rounded: half the width and height."""
        first, second = (_every_other(image, place).astype(np.uint32) for place in self.value)
        mean: Image = ((first + second + 1) >> 1).astype(image.dtype)
        return mean


@dataclass(frozen=True)
class Mosaic:
    """Where the colours of a Bayer mosaic are.

    Attributes
    ----------
    pattern
        Colours of a 2×2 block from left to right and from top to bottom: ``rggb``, ``bggr``, ``grbg`` or ``gbrg``.
    """

    PATTERNS: ClassVar = ("rggb", "bggr", "grbg", "gbrg")

    pattern: str

    def __post_init__(self) -> None:
        if self.pattern not in self.PATTERNS:
            raise SettingError(f"no Bayer pattern is called '{self.pattern}'; known: {', '.join(self.PATTERNS)}")

    @property
    def green(self) -> GreenPixels:
        """Its green pixels."""
        return GreenPixels.FALLING if self.pattern.startswith("g") else GreenPixels.RISING

    def red(self, image: Image) -> Image:
        """Return the red pixel of each block: half the width and height."""
        return _every_other(image, divmod(self.pattern.index("r"), 2))

    def blue(self, image: Image) -> Image:
        """Return the blue pixel of each block: half the width and height."""
        return _every_other(image, divmod(self.pattern.index("b"), 2))


def find_green(image: Image) -> GreenPixels | None:
    """Find out whether an image is a Bayer mosaic, and where its green pixels are; None where it is none.

    In a grey image neighbours in a row or column resemble each other more than those on a diagonal, which are farther
    apart. In a mosaic the two green pixels of a block, on a diagonal, resemble each other most.

    Parameters
    ----------
    image
        Shape (height, width).
    """
    if image.shape[0] % 2 or image.shape[1] % 2:
        return None
    top, left = (max(0, (length - _LOOKED_AT) // 4 * 2) for length in image.shape)
    part = image[top : top + _LOOKED_AT, left : left + _LOOKED_AT]
    block = {(i, j): part[i::2, j::2].astype(np.int32) for i in (0, 1) for j in (0, 1)}
    along = min(
        _distance(block, (0, 0), (0, 1)) + _distance(block, (1, 0), (1, 1)),
        _distance(block, (0, 0), (1, 0)) + _distance(block, (0, 1), (1, 1)),
    )
    diagonal = {green: _distance(block, *green.value) for green in GreenPixels}
    green = min(GreenPixels, key=lambda g: diagonal[g])
    return green if diagonal[green] < _MOSAIC_RATIO * along / 2 else None


def _distance(block: Mapping[tuple[int, int], Image], first: tuple[int, int], second: tuple[int, int]) -> float:
    return float(np.abs(block[first] - block[second]).mean())


def _every_other(image: Image, place: tuple[int, int]) -> Image:
    # Odd sizes lose their last row or column: a block needs both.
    height, width = (length // 2 * 2 for length in image.shape)
    return np.ascontiguousarray(image[place[0] : height : 2, place[1] : width : 2])
