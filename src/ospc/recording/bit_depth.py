"""How many of the 16 bits a 16-bit image uses, and at which end of the word they are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ospc.arrays import Image

_SENSOR_BITS = (8, 10, 12, 14, 16)


@dataclass(frozen=True)
class BitDepth:
    """Bits of a sensor and where they lie in the stored word.

    Attributes
    ----------
    bits
        Bits the sensor delivers.
    shift
        Empty bits below them: 0 where the values are right-aligned.
    stored_bits
        Bits of the stored word, 8 or 16.
    """

    bits: int
    shift: int = 0
    stored_bits: int = 8

    @property
    def max_grey(self) -> int:
        """Largest grey value, after the shift."""
        return (1 << self.bits) - 1

    @property
    def note(self) -> str | None:
        """What was found, for a user to contradict; None for 8 bit."""
        if self.stored_bits == 8:
            return None
        aligned = f"left-aligned, shifted right by {self.shift}" if self.shift else "right-aligned"
        used = "" if self.bits == 16 else f", {aligned}"
        return f"16-bit images are taken as {self.bits}-bit grey values{used}: largest grey value {self.max_grey}"


def detect_bit_depth(images: Iterable[Image]) -> BitDepth:
    """Find the bit depth from sample images, the brighter the better.

    Bits that are zero everywhere are unused: below the values they tell left-aligned data, above them right-aligned.

    Parameters
    ----------
    images
        Grey images, uint8 or uint16, shape (height, width).
    """
    union = 0
    for image in images:
        if image.dtype == np.uint8:
            return BitDepth(8)
        union |= int(np.bitwise_or.reduce(image, axis=None))
    if union == 0:
        return BitDepth(16, 0, 16)
    highest = union.bit_length()
    if highest == 16:
        empty_below = (union & -union).bit_length() - 1
        bits = next(b for b in _SENSOR_BITS if b >= 16 - empty_below)
        return BitDepth(bits, 16 - bits, 16)
    return BitDepth(next(b for b in _SENSOR_BITS if b >= highest), 0, 16)
