"""Channels of colour images and of Bayer mosaics."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import SettingError


class Channel(Enum):
    """A channel of colour images.

    Response and vignette may differ between channels, and luma mixes the three. ``ALL`` keeps images in colour; they
    can be corrected, but not calibrated.
    """

    LUMINANCE = "luminance"
    RED = "red"
    GREEN = "green"
    BLUE = "blue"
    ALL = "all"

    def of(self, image: Image) -> Image:
        """Return the channel of an image with shape (height, width, 3) in the order blue, green, red."""
        if self is Channel.ALL:
            return image
        if self is Channel.LUMINANCE:
            return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return np.ascontiguousarray(image[:, :, (Channel.BLUE, Channel.GREEN, Channel.RED).index(self)])


DEFAULT_CHANNEL = Channel.GREEN
"""The channel of colour images that is used unless another is chosen. The luma of coloured surfaces follows no single
response, and hides that one of their channels is saturated: in a simulated coloured room, it raised the RMSE of the
vignette from 0.0003 to 0.003."""

_MOSAIC_RATIO = 0.7
"""Threshold for the ratio of diagonal to adjacent differences: 0.31–0.45 in mosaics and 1.15 in grey images."""

_TESTED_PX = 1024
"""Width and height of the tested central part; even, so that it consists of whole 2×2 blocks."""


@dataclass(frozen=True)
class Mosaic:
    """Arrangement of the colours in a Bayer mosaic.

    The pattern names the colours of a 2×2 block from left to right and from top to bottom: ``rggb``, ``bggr``,
    ``grbg`` or ``gbrg``; ``g..g`` or ``.gg.`` if only the green pixels are known.
    """

    PATTERNS: ClassVar = ("rggb", "bggr", "grbg", "gbrg")
    GREEN_PATTERNS: ClassVar = ("g..g", ".gg.")

    pattern: str

    def __post_init__(self) -> None:
        if self.pattern not in self.PATTERNS + self.GREEN_PATTERNS:
            raise SettingError(f"'{self.pattern}' is not a Bayer pattern; known: {', '.join(self.PATTERNS)}")

    @property
    def complete(self) -> bool:
        """Whether the positions of red and blue are known."""
        return self.pattern in self.PATTERNS

    def of(self, image: Image, channel: Channel) -> Image:
        """Return a channel at half the width and height; green is the rounded mean of the two pixels of a block.

        ``ALL`` gives shape (height, width, 3) in the order blue, green, red.
        """
        if channel in (Channel.LUMINANCE, Channel.ALL):
            blocks = [self.of(image, colour) for colour in (Channel.BLUE, Channel.GREEN, Channel.RED)]
            return channel.of(np.stack(blocks, axis=2))
        # Images of odd size lose their last row or column, which has no complete block.
        height, width = (length // 2 * 2 for length in image.shape)
        pixels = [image[row:height:2, column:width:2] for row, column in self.places(channel)]
        if channel is Channel.GREEN:
            first, second = (part.astype(np.uint32) for part in pixels)
            total = first + second
            # Halves are rounded to even values: always up would brighten the image by a quarter of a grey value.
            return np.asarray(((total + (total >> 1 & 1)) >> 1).astype(image.dtype))
        return np.ascontiguousarray(pixels[0])

    def places(self, channel: Channel) -> list[tuple[int, int]]:
        """Return row and column of the pixels of a colour within a block."""
        return [divmod(index, 2) for index, letter in enumerate(self.pattern) if letter == channel.value[0]]


def find_mosaic(image: Image) -> Mosaic | None:
    """Return a mosaic with known green pixels if an image of shape (height, width) looks like one, otherwise None.

    In a grey image, horizontal and vertical neighbours are more similar than diagonal ones, which are further apart.
    In a mosaic, the two green pixels on the diagonal of a block are the most similar.
    """
    if image.shape[0] % 2 or image.shape[1] % 2:
        return None
    top, left = (max(0, (length - _TESTED_PX) // 4 * 2) for length in image.shape)
    part = image[top : top + _TESTED_PX, left : left + _TESTED_PX]
    block = {(i, j): part[i::2, j::2].astype(np.int32) for i in (0, 1) for j in (0, 1)}

    def distance(first: tuple[int, int], second: tuple[int, int]) -> float:
        return float(np.abs(block[first] - block[second]).mean())

    along = min(
        distance((0, 0), (0, 1)) + distance((1, 0), (1, 1)),
        distance((0, 0), (1, 0)) + distance((0, 1), (1, 1)),
    )
    diagonal = {pattern: distance(*Mosaic(pattern).places(Channel.GREEN)) for pattern in Mosaic.GREEN_PATTERNS}
    pattern = min(diagonal, key=diagonal.__getitem__)
    return Mosaic(pattern) if diagonal[pattern] < _MOSAIC_RATIO * along / 2 else None
