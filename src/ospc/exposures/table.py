"""The exposures written beside the frames, by frame number, and the lag they are corrected by."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray

_FIRST_CAPACITY = 1024
"""Exposures that the table holds before it grows, each time to twice its size."""

_BLOCK = 2**14
"""Exposures looked at together: what is computed of them fits in the processor's cache, and endless runs do not fill
the memory."""


@dataclass
class ExposureTable:
    """Grows by one exposure a frame, and looks them up by frame number.

    Attributes
    ----------
    lag_frames
        By how many frames the exposures are written late: that of frame i is looked up beside frame i + lag.
    trusted
        Whether the images were found to agree with the exposures.
    """

    lag_frames: int = 0
    trusted: bool = False
    _log_exposure: FloatArray = field(default_factory=lambda: np.empty(_FIRST_CAPACITY), repr=False)
    _count: int = 0

    @classmethod
    def of(cls, log_exposure: FloatArray, lag_frames: int = 0, *, trusted: bool = False) -> ExposureTable:
        """Return the table of exposures as they were written, ln of milliseconds, shape (frames,)."""
        room = np.empty(max(_FIRST_CAPACITY, 2 * len(log_exposure)))
        room[: len(log_exposure)] = log_exposure
        return cls(lag_frames, trusted, room, len(log_exposure))

    def append(self, exposure_ms: float) -> int:
        """Take the exposure written beside the next frame, NaN where there is none, and return the frame's number."""
        if self._count == len(self._log_exposure):
            # What is not yet written to takes no memory, so that each frame costs eight bytes.
            room = np.empty(2 * self._count)
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

    def with_lag(self, lag_frames: int) -> ExposureTable:
        """Return the same exposures as they are at another lag."""
        return replace(self, lag_frames=lag_frames)

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
    missing, neighbours = np.flatnonzero(~known), np.flatnonzero(known & _beside(~known))
    complete = log_exposure.copy()
    complete[missing] = np.interp(missing, neighbours, log_exposure[neighbours])
    return complete


def blocks(log_exposure: FloatArray, shared: int) -> Iterator[FloatArray]:
    """Give all exposures, a bounded number at a time; each block begins with so many values of the one before."""
    for start in range(0, max(len(log_exposure) - shared, 1), _BLOCK):
        yield log_exposure[start : start + _BLOCK + shared]


def _beside(there: BoolArray) -> BoolArray:
    """Return the places next to those that are true."""
    beside = np.zeros_like(there)
    beside[1:] |= there[:-1]
    beside[:-1] |= there[1:]
    return beside
