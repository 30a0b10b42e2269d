"""The bits of 16-bit words that grey values use, which show whether those of a sensor are left- or right-aligned."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ospc.arrays import Image

_WORD_BITS = 16
"""Number of bits of a stored word."""


@dataclass(frozen=True)
class UsedBits:
    """Bits that are set in at least one pixel of some images, and whether all pixels have the same value."""

    in_any: int
    blank: bool

    @classmethod
    def of(cls, images: Iterable[Image]) -> UsedBits:
        """Return the bits that uint16 images use."""
        in_any, blank = 0, True
        for number, image in enumerate(images):
            before, in_any = in_any, in_any | int(np.bitwise_or.reduce(image, axis=None))
            same = number == 0 or in_any == before
            # The second pass over the pixels is rare: the first pixel seldom has all the bits.
            blank = blank and same and int(image.flat[0]) == in_any and bool(np.all(image == in_any))
        return cls(in_any, blank)

    def shift_for(self, max_grey: int) -> int | None:
        """Return the number of unused low bits if the values are those of a sensor with this largest grey value.

        It is 0 for right-aligned values, and None if a value has more bits than the sensor. Values without any of the
        low bits that a sensor leaves are left-aligned, however dark, because real images vary by single grey values.
        Images with only one value do not show that.
        """
        bits = max_grey.bit_length()
        unused = _WORD_BITS - bits
        if self.in_any & ((1 << unused) - 1) == 0 and not self.blank:
            return unused
        return 0 if self.in_any < 1 << bits else None
