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
    """Bits that are set in at least one pixel of some images, and those that are set in all pixels."""

    in_any: int
    in_all: int

    @classmethod
    def of(cls, images: Iterable[Image]) -> UsedBits:
        """Return the bits that uint16 images use."""
        in_any, in_all = 0, (1 << _WORD_BITS) - 1
        for image in images:
            in_any |= int(np.bitwise_or.reduce(image, axis=None))
            in_all &= int(np.bitwise_and.reduce(image, axis=None))
        return cls(in_any, in_all)

    def shift_for(self, max_grey: int) -> int | None:
        """Return the number of unused low bits if the values are those of a sensor with this largest grey value.

        It is 0 for right-aligned values, and None if a value has more bits than the sensor. Values without any of the
        low bits that a sensor leaves are left-aligned, however dark, because real images vary by single grey values.
        Images with only one value do not show that.
        """
        bits = max_grey.bit_length()
        unused = _WORD_BITS - bits
        blank = self.in_any == self.in_all
        if self.in_any & ((1 << unused) - 1) == 0 and not blank:
            return unused
        return 0 if self.in_any < 1 << bits else None
