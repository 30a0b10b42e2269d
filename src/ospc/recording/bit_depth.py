"""The bit depth of 16-bit images, and at which end of the word the bits are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ospc.arrays import Image

_SENSOR_BITS = (8, 10, 12, 14, 16)
"""Bit depths of sensors; others do not exist."""


@dataclass(frozen=True)
class BitDepth:
    """Bits of a sensor and their position in the stored word.

    Attributes
    ----------
    bits
        Bits that the sensor delivers.
    shift
        Empty bits below them; 0 if the values are right-aligned.
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
        """The result for the user to check; None for 8 bits."""
        if self.stored_bits == 8:
            return None
        aligned = f"left-aligned, shifted right by {self.shift}" if self.shift else "right-aligned"
        used = "" if self.bits == 16 else f", {aligned}"
        return f"16-bit images are taken as {self.bits}-bit grey values{used}: largest grey value {self.max_grey}"


def detect_bit_depth(images: Iterable[Image]) -> BitDepth:
    """Infer the bit depth from sample images, the brighter the better.

    Bits that are zero everywhere are unused: low ones in left-aligned data, high ones in right-aligned data.
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
