"""The range of grey values from black to white if it is not the full scale, as in limited-range video."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray
from ospc.errors import FrameError, OspcError
from ospc.photometry.noise import NoiseModel

LARGEST_GREY = 65535
"""Largest grey value of any image: 16 bits."""
_NOISE_LEVELS = 256
"""Grey levels at which the noise of stretched images is tabulated: those of 8 bits."""
_UNCERTAINTY = 2.5 / 255
"""Accuracy of black and white whose values scatter: two 8-bit grey values."""


def checked_max_grey(max_grey: int, name: str, kind: type[OspcError] = FrameError) -> int:
    """Return the largest grey value as int; an error of this kind if it is not an integer or exceeds 16 bits."""
    whole = isinstance(max_grey, int | np.integer) and not isinstance(max_grey, bool)
    if not whole or not 1 <= max_grey <= LARGEST_GREY:
        raise kind(f"{name}: max_grey is {max_grey!r}; give a whole number from 1 to {LARGEST_GREY}")
    return int(max_grey)


@dataclass(frozen=True)
class GreyRange:
    """Black and white, the grey levels in [0, 1] at which values are clipped; 0 and 1 for the full scale."""

    black: float = 0.0
    white: float = 1.0

    @property
    def is_full(self) -> bool:
        """Whether black and white are the ends of the scale."""
        return self == GreyRange()

    def resembles(self, other: GreyRange) -> bool:
        """Whether both ends are the same within the uncertainty of scattered values."""
        return max(abs(self.black - other.black), abs(self.white - other.white)) < _UNCERTAINTY

    def in_words(self, max_grey: int) -> str:
        """Return black and white as grey values, such as "16 and 235 of 255"."""
        return f"{round(max_grey * self.black)} and {round(max_grey * self.white)} of {max_grey}"

    def note(self, max_grey: int) -> str:
        """Return a note on the range in grey values; empty if it is full."""
        ends = (("below", "black", self.black, 0.0), ("above", "white", self.white, 1.0))
        return "; ".join(
            f"hardly any grey value is {where} {round(max_grey * level)} of {max_grey}, which is taken for {name}"
            for where, name, level, usual in ends
            if level != usual
        )

    def stretched_noise(self, noise: NoiseModel) -> NoiseModel:
        """Return the noise of stretched grey levels."""
        if self.is_full:
            return noise
        variance = noise.variance(self.grey(np.linspace(0, 1, _NOISE_LEVELS))) / self.span**2
        lowest, highest = self.level(noise.measured).tolist()
        return replace(noise, table=tuple(variance.tolist()), measured=(lowest, highest))

    def level(self, grey: npt.ArrayLike) -> FloatArray:
        """Return grey levels stretched to the full scale and clipped to [0, 1]."""
        return np.clip((np.asarray(grey, dtype=np.float64) - self.black) / self.span, 0.0, 1.0)

    def grey(self, level: npt.ArrayLike) -> FloatArray:
        """Return the original grey levels of stretched ones."""
        return np.asarray(self.black + self.span * np.asarray(level, dtype=np.float64))

    def with_black_at(self, level: float) -> GreyRange:
        """Return the range with black at a stretched grey level."""
        return replace(self, black=self.black + level * self.span)

    @property
    def span(self) -> float:
        """White minus black."""
        return self.white - self.black


FULL_RANGE = GreyRange()
"""Black and white at the ends of the scale."""
VIDEO_RANGE = GreyRange(16 / 255, 235 / 255)
"""Limited range of video (ITU-R BT.601)."""
