"""The exposures written beside the frames: looked up by frame number at some lag, and their course as a whole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.settings.exposures import (
    CHANGED_EXPOSURE_LOG,
    CONSTANT_EXPOSURE_LOG,
    MAX_CYCLE_FRAMES,
    MIN_CYCLE_SHARE,
    MIN_CYCLES,
    SAME_EXPOSURE_LOG,
)

_FIRST_CAPACITY = 1024
"""Exposures that the table holds before it grows, each time to twice its size."""

_BLOCK = 2**14
"""Exposures looked at together: they fit in the processor's cache, and endless runs do not fill the memory."""


@dataclass
class ExposureTable:
    """Grows by one exposure a frame, and looks them up by frame number.

    The exposures are written ``lag_frames`` late: that of frame i is looked up beside frame i + lag. They are
    ``trusted`` where the images were found to agree with them.
    """

    lag_frames: int = 0
    trusted: bool = False
    _log_exposure: FloatArray = field(default_factory=lambda: np.empty(_FIRST_CAPACITY), repr=False)
    _count: int = 0

    @classmethod
    def of(cls, log_exposure: FloatArray, lag_frames: int = 0, *, trusted: bool = False) -> ExposureTable:
        """Return the table of exposures as they were written, ln of milliseconds, shape (frames,)."""
        return cls(lag_frames, trusted, log_exposure, len(log_exposure))

    def append(self, exposure_ms: float) -> int:
        """Take the exposure written beside the next frame, NaN where there is none, and return the frame's number."""
        if self._count == len(self._log_exposure):
            # What is not yet written to takes no memory, so that each frame costs eight bytes.
            room = np.empty(max(_FIRST_CAPACITY, 2 * self._count))
            room[: self._count] = self._log_exposure
            self._log_exposure = room
        known_ms = exposure_ms if 0 < exposure_ms < np.inf else np.nan
        self._log_exposure[self._count] = np.log(known_ms)
        self._count += 1
        return self._count - 1

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._count

    @property
    def written(self) -> FloatArray:
        """Ln of the exposures in milliseconds as written, NaN where there is none, shape (frames,)."""
        return self._log_exposure[: self._count]

    def log_exposure_of(self, frames: IntArray) -> FloatArray:
        """Return ln of the exposure in milliseconds of frames, NaN where it is unknown, shape (n,) -> (n,)."""
        beside = np.asarray(frames) + self.lag_frames
        known = (beside >= 0) & (beside < self._count)
        found = np.full(beside.shape, np.nan)
        found[known] = self._log_exposure[beside[known]]
        return found

    def until(self, frame: int) -> ExposureTable:
        """Return the table of the frames before one."""
        return replace(self, _count=min(frame, self._count))


def filled(log_exposure: FloatArray) -> FloatArray:
    """Return the exposures with missing ones interpolated, so that their neighbours can still be compared.

    Where none is missing, they are not copied.
    """
    known = np.isfinite(log_exposure)
    if known.all():
        return log_exposure
    if not known.any():
        return np.zeros(len(log_exposure))
    missing = np.flatnonzero(~known)
    # Only the known ones next to missing ones: most of a long recording is known.
    neighbours = np.flatnonzero(known & (np.append(~known[1:], False) | np.append(False, ~known[:-1])))
    complete = log_exposure.copy()
    complete[missing] = np.interp(missing, neighbours, log_exposure[neighbours])
    return complete


@dataclass(frozen=True)
class ExposureReport:
    """The course of the exposures written, over all frames.

    Attributes
    ----------
    lowest_ms, highest_ms
        Extremes.
    values
        Number of different exposures.
    changed_share
        Share of the frames whose exposure differs from that of the frame before by 1 % or more.
    cycle_frames
        Number of frames after which they repeat; None if they do not.
    """

    lowest_ms: float
    highest_ms: float
    values: int
    changed_share: float
    cycle_frames: int | None

    @classmethod
    def of(cls, log_exposure: FloatArray) -> ExposureReport:
        """Describe exposures by ln of their milliseconds, shape (frames,)."""
        parts = [*_blocks(log_exposure, 1)]
        changed = sum(int(np.count_nonzero(np.abs(np.diff(part)) >= CHANGED_EXPOSURE_LOG)) for part in parts)
        return cls(
            float(np.exp(log_exposure.min())),
            float(np.exp(log_exposure.max())),
            len(np.unique(np.concatenate([np.unique(part) for part in parts]))),
            changed / max(len(log_exposure) - 1, 1),
            exposure_cycle(log_exposure),
        )

    @property
    def ratio(self) -> float:
        """Longest over shortest exposure."""
        return self.highest_ms / self.lowest_ms

    def in_words(self) -> str:
        """Return the range of exposures, such as "1 to 32 ms"."""
        if self.values == 1:
            return f"{self.lowest_ms:.4g} ms"
        return f"{self.lowest_ms:.4g} to {self.highest_ms:.4g} ms"


def exposure_cycle(log_exposure: FloatArray) -> int | None:
    """Return after how many frames ln of exposures, shape (frames,), repeats; None if it does not, or is constant."""
    if np.ptp(log_exposure) < CONSTANT_EXPOSURE_LOG:
        return None
    periods = range(2, min(MAX_CYCLE_FRAMES, len(log_exposure) // MIN_CYCLES) + 1)
    return next((period for period in periods if _repeat(log_exposure, period)), None)


def _repeat(log_exposure: FloatArray, period: int) -> bool:
    """Return whether most exposures are those of a number of frames before."""
    pairs = same = len(log_exposure) - period
    for block in _blocks(log_exposure, period):
        same -= int(np.count_nonzero(np.abs(block[period:] - block[:-period]) >= SAME_EXPOSURE_LOG))
        if same / pairs < MIN_CYCLE_SHARE:
            return False
    return True


def _blocks(log_exposure: FloatArray, shared: int) -> Iterator[FloatArray]:
    """Give all exposures, a bounded number at a time; each block begins with so many values of the one before."""
    for start in range(0, max(len(log_exposure) - shared, 1), _BLOCK):
        yield log_exposure[start : start + _BLOCK + shared]
