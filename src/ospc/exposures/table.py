"""The recorded exposures: a table indexed by frame number, with a lag, and summary statistics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.errors import plain
from ospc.photometry.correction import EXPOSURE_RANGE_MS
from ospc.settings.exposures import (
    CHANGED_EXPOSURE_LOG,
    CONSTANT_EXPOSURE_LOG,
    EVEN_STEP_LOG,
    MAX_CYCLE_FRAMES,
    MIN_CYCLE_SHARE,
    MIN_CYCLES,
    SAME_EXPOSURE_LOG,
)

_FIRST_CAPACITY = 1024
"""Initial capacity of the table; it doubles whenever it is full."""
_BLOCK = 2**14
"""Exposures processed at a time: few enough for the processor's cache, and memory stays bounded in endless runs."""


@dataclass
class ExposureTable:
    """Table of recorded exposures that grows by one entry per frame.

    The exposures lag by ``lag_frames``: the exposure of frame i is recorded with frame i + lag. They are ``trusted``
    if the images agree with them.
    """

    lag_frames: int = 0
    trusted: bool = False
    _log_exposure: FloatArray = field(default_factory=lambda: np.empty(_FIRST_CAPACITY), repr=False)
    _count: int = 0

    @classmethod
    def of(cls, log_exposure: FloatArray, lag_frames: int = 0, *, trusted: bool = False) -> ExposureTable:
        """Return a table of recorded exposures, given as ln of milliseconds, shape (frames,)."""
        return cls(lag_frames, trusted, log_exposure, len(log_exposure))

    def append(self, exposure_ms: float) -> int:
        """Add the exposure recorded with the next frame, NaN if missing or impossible; return the frame's number."""
        lowest_ms, highest_ms = EXPOSURE_RANGE_MS
        if self._count == len(self._log_exposure):
            room = np.empty(max(_FIRST_CAPACITY, 2 * self._count))
            room[: self._count] = self._log_exposure
            self._log_exposure = room
        known_ms = exposure_ms if lowest_ms <= exposure_ms <= highest_ms else np.nan
        self._log_exposure[self._count] = np.log(known_ms)
        self._count += 1
        return self._count - 1

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._count

    @property
    def log_recorded(self) -> FloatArray:
        """Ln of the exposures in milliseconds as recorded, NaN if missing, shape (frames,)."""
        return self._log_exposure[: self._count]

    def log_exposure_of(self, frames: IntArray) -> FloatArray:
        """Return ln of the exposure in milliseconds of each frame, NaN if unknown, shape (n,) -> (n,)."""
        entry = np.asarray(frames) + self.lag_frames
        known = (entry >= 0) & (np.maximum(entry, frames) < self._count)
        found = np.full(entry.shape, np.nan)
        found[known] = self._log_exposure[entry[known]]
        return found

    def without(self, frames: Sequence[int]) -> ExposureTable:
        """Return a table in which the exposures recorded with some frames are missing."""
        return replace(self, _log_exposure=without(self._log_exposure, frames))

    def before(self, frame: int) -> ExposureTable:
        """Return the table of the frames before the given one."""
        return replace(self, _count=min(frame, self._count))


def without(log_exposure: FloatArray, frames: Sequence[int]) -> FloatArray:
    """Return the exposures with those of some frames missing; the input itself if there are no such frames."""
    if not frames:
        return log_exposure
    known = log_exposure.copy()
    known[list(frames)] = np.nan
    return known


def filled(log_exposure: FloatArray) -> FloatArray:
    """Return the exposures with missing ones interpolated, so that their neighbours can still be compared.

    The input itself is returned if none is missing.
    """
    known = np.isfinite(log_exposure)
    if known.all():
        return log_exposure
    if not known.any():
        return np.zeros(len(log_exposure))
    missing = np.flatnonzero(~known)
    # Interpolate from the known neighbours of missing exposures only: in a long recording, most are known.
    neighbours = np.flatnonzero(known & (np.append(~known[1:], False) | np.append(False, ~known[:-1])))
    complete = log_exposure.copy()
    complete[missing] = np.interp(missing, neighbours, log_exposure[neighbours])
    return complete


@dataclass(frozen=True)
class ExposureReport:
    """Summary of the recorded exposures over all frames."""

    lowest_ms: float
    """Shortest exposure."""
    highest_ms: float
    """Longest exposure."""
    values: int
    """Number of different exposures."""
    changed_share: float
    """Share of the frames whose exposure differs from that of the previous frame by 1 % or more."""
    cycle_frames: int | None
    """Number of frames after which the exposures repeat; None if they do not."""
    changes_evenly: bool
    """Whether each exposure is the one before it multiplied by the same factor, as in a sweep. Exposure ratios are
    then the same at any lag."""

    @classmethod
    def of(cls, log_exposure: FloatArray) -> ExposureReport:
        """Summarise exposures, given as ln of milliseconds, shape (frames,)."""
        parts = [*_blocks(log_exposure, 1)]
        changed = sum(int(np.count_nonzero(np.abs(np.diff(part)) >= CHANGED_EXPOSURE_LOG)) for part in parts)
        usual = float(log_exposure[-1] - log_exposure[0]) / max(len(log_exposure) - 1, 1)
        unevenness = max(float(np.abs(np.diff(part) - usual).max(initial=0.0)) for part in parts)
        return cls(
            lowest_ms=float(np.exp(log_exposure.min())),
            highest_ms=float(np.exp(log_exposure.max())),
            values=len(np.unique(np.concatenate([np.unique(part) for part in parts]))),
            changed_share=changed / max(len(log_exposure) - 1, 1),
            cycle_frames=exposure_cycle(log_exposure),
            changes_evenly=unevenness < EVEN_STEP_LOG,
        )

    @property
    def ratio(self) -> float:
        """Longest over shortest exposure."""
        return self.highest_ms / self.lowest_ms

    def in_words(self, unit: str = " ms") -> str:
        """Return the range of exposures, such as "1 to 32 ms"."""
        return range_in_words(self.lowest_ms, self.highest_ms, unit)


def range_in_words(lowest: float, highest: float, unit: str = " ms") -> str:
    """Return a range of exposures, such as "1 to 32 ms", or "10 ms" if both are equal in four digits."""
    first, last = plain(lowest), plain(highest)
    return f"{first}{unit}" if first == last else f"{first} to {last}{unit}"


def exposure_cycle(log_exposure: FloatArray) -> int | None:
    """Return the period in frames of ln exposures, shape (frames,); None if they are constant or do not repeat."""
    if np.ptp(log_exposure) < CONSTANT_EXPOSURE_LOG:
        return None
    periods = range(2, min(MAX_CYCLE_FRAMES, len(log_exposure) // MIN_CYCLES) + 1)
    return next((period for period in periods if _repeat(log_exposure, period)), None)


def _repeat(log_exposure: FloatArray, period: int) -> bool:
    """Return whether most exposures equal those one period earlier."""
    pairs = same = len(log_exposure) - period
    for block in _blocks(log_exposure, period):
        same -= int(np.count_nonzero(np.abs(block[period:] - block[:-period]) >= SAME_EXPOSURE_LOG))
        if same / pairs < MIN_CYCLE_SHARE:
            return False
    return True


def _blocks(log_exposure: FloatArray, shared: int) -> Iterator[FloatArray]:
    """Yield the exposures in blocks of bounded size; consecutive blocks overlap by ``shared`` values."""
    for start in range(0, max(len(log_exposure) - shared, 1), _BLOCK):
        yield log_exposure[start : start + _BLOCK + shared]
