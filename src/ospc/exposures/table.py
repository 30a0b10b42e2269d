"""The exposures written beside the frames, by frame number, and the lag they are corrected by."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray

_FIRST_CAPACITY = 1024
"""Exposures that the table holds before it grows, each time to twice its size."""


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
            self._log_exposure = np.concatenate([self._log_exposure, np.empty(self._count)])
        known = np.isfinite(exposure_ms) and exposure_ms > 0
        self._log_exposure[self._count] = np.log(exposure_ms) if known else np.nan
        self._count += 1
        return self._count - 1

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._count

    @property
    def written(self) -> FloatArray:
        """Ln of the exposures in milliseconds as written, NaN where there is none, shape (frames,)."""
        return self._log_exposure[: self._count]

    @property
    def log_exposure(self) -> FloatArray:
        """Ln of every frame's own exposure in milliseconds, NaN where it is unknown, shape (frames,)."""
        return self.log_exposure_of(np.arange(self._count))

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

    def range_ms(self) -> tuple[float, float]:
        """Return the shortest and the longest exposure in milliseconds; (inf, 0) where none is known."""
        known = self.log_exposure
        known = known[np.isfinite(known)]
        return (float(np.exp(known.min())), float(np.exp(known.max()))) if known.size else (np.inf, 0.0)


def filled(log_exposure: FloatArray) -> FloatArray:
    """Return the exposures with missing ones interpolated, so that their neighbours can still be compared."""
    known = np.isfinite(log_exposure)
    if known.all() or not known.any():
        return np.where(known, log_exposure, 0.0)
    frames = np.arange(len(log_exposure))
    return np.interp(frames, frames[known], log_exposure[known])
