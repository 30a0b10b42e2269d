"""Periodic changes of brightness that the exposure does not explain: lamps on alternating current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray

_MIN_VALUES = 24
_LOWEST_CYCLES = 4
_LEAST_PERIODS = 2
_OVERSAMPLING = 8
_MIN_SHARE = 0.4
_CHANCE = 1e-4
_MIN_AMPLITUDE = 0.003
_LARGEST_GAP = 8


@dataclass(frozen=True)
class Flicker:
    """A periodic change of brightness.

    Attributes
    ----------
    cycles_per_frame
        Its frequency as the frames sample it, at most 0.5.
    log_amplitude
        Amplitude of the change from one frame to the next, in ln of the grey level.
    share
        Share of the fast unexplained changes that it makes up.
    """

    cycles_per_frame: float
    log_amplitude: float
    share: float

    @property
    def brightness_amplitude(self) -> float:
        """Relative amplitude of the brightness itself: half the difference between extremes, over the mean."""
        return self.log_amplitude / float(2 * np.sin(np.pi * self.cycles_per_frame))


def find_flicker(frame: IntArray, change: FloatArray) -> Flicker | None:
    """Find the strongest periodic part of changes from frame to frame.

    Parameters
    ----------
    frame
        Index of the frame of each value, increasing; where many frames are missing between two, the phase is free to
        be another after them, shape (n,).
    change
        Unexplained change of ln brightness, shape (n,).

    Returns
    -------
    Flicker or None
        None where no frequency stands out (Fisher's test of the largest share of a periodogram). Changes slower than
        a few periods in the time seen are none of flicker.
    """
    runs = _runs(frame)
    if not runs or max(run.stop - run.start for run in runs) < _MIN_VALUES:
        return None
    # Single large values (a scene cut, a passing hand) have a flat spectrum, which would hide every line.
    middle = np.median(change)
    spread = 4 * (1.4826 * float(np.median(np.abs(change - middle))) + 1e-6)
    value = np.clip(change - middle, -spread, spread)
    grids = [_on_grid(frame[run], value[run]) for run in runs]
    length = _OVERSAMPLING * max(len(grid) for grid in grids)
    power = sum((np.abs(np.fft.rfft(grid, length)) ** 2 for grid in grids), np.zeros(length // 2 + 1))
    frequency = np.fft.rfftfreq(length)
    line = float(frequency[np.argmax(np.where(frequency >= _lowest(grids), power, 0.0))])
    fitted = value - without_waves(frame, value, [line])
    share = min(float(np.var(fitted)) / max(float(np.var(fast_part(frame, value))), 1e-12), 1.0)
    # Chance that the largest of so many independent lines of white noise has this share of the power.
    lines = len(value) // 2
    chance = lines * (1 - min(share, 0.999)) ** max(lines / len(runs) - 1, 1.0)
    amplitude = float(np.sqrt(2) * np.std(fitted))
    if amplitude < _MIN_AMPLITUDE or share < _MIN_SHARE or chance > _CHANCE:
        return None
    return Flicker(line, amplitude, share)


def main_line(frame: IntArray, change: FloatArray) -> tuple[float, float] | None:
    """Return the frequency that changes have most of, in cycles per frame, and its share of their energy.

    Parameters
    ----------
    frame
        Index of the frame of each value, increasing, shape (n,).
    change
        The values, shape (n,).

    Returns
    -------
    tuple of float or None
        None where no run of frames is long enough. Frequencies with less than two periods in a run count for nothing.
    """
    runs = _runs(frame)
    energy = float(np.sum(change**2))
    if not runs or max(run.stop - run.start for run in runs) < _MIN_VALUES or energy <= 0:
        return None
    grids = [_on_grid(frame[run], change[run]) for run in runs]
    length = _OVERSAMPLING * max(len(grid) for grid in grids)
    power = sum((np.abs(np.fft.rfft(grid, length)) ** 2 for grid in grids), np.zeros(length // 2 + 1))
    frequency = np.fft.rfftfreq(length)
    line = float(frequency[np.argmax(np.where(frequency >= _LEAST_PERIODS / max(map(len, grids)), power, 0.0))])
    left = without_waves(frame, change, [line])
    return line, 1 - float(np.sum(left**2)) / energy


def waves(frame: IntArray, cycles_per_frame: Sequence[float]) -> FloatArray:
    """Return a cosine and a sine of each frequency, of its own phase in each run of frames, shape (n, columns)."""
    columns = []
    for run in _runs(frame):
        angle = 2 * np.pi * np.outer(frame, cycles_per_frame)
        inside = np.zeros((len(frame), 1))
        inside[run] = 1
        columns.append(np.column_stack([np.cos(angle), np.sin(angle)]) * inside)
    return np.column_stack(columns) if columns else np.empty((len(frame), 0))


def without_waves(frame: IntArray, change: FloatArray, cycles_per_frame: Sequence[float]) -> FloatArray:
    """Return changes without what waves of these frequencies explain of them, in each run of frames, shape (n,)."""
    left = change.copy()
    for run in _runs(frame):
        columns = waves(frame[run], cycles_per_frame)
        left[run] -= columns @ np.linalg.lstsq(columns, change[run], rcond=None)[0]
    return left


def in_long_runs(frame: IntArray) -> BoolArray:
    """Return which values belong to runs of frames long enough to show flicker, shape (n,)."""
    long = np.zeros(len(frame), dtype=bool)
    for run in _runs(frame):
        long[run] = run.stop - run.start >= _MIN_VALUES
    return long


def fast_part(frame: IntArray, change: FloatArray) -> FloatArray:
    """Return changes without what is slower than a few periods in the time seen.

    Parameters
    ----------
    frame
        Index of the frame of each value, increasing, shape (n,).
    change
        The values, shape (n,).
    """
    fast = np.zeros(len(change))
    for run in _runs(frame):
        grid = _on_grid(frame[run], change[run] - change[run].mean())
        spectrum = np.fft.rfft(grid)
        spectrum[np.fft.rfftfreq(len(grid)) < _lowest([grid])] = 0
        fast[run] = np.fft.irfft(spectrum, len(grid))[frame[run] - frame[run.start]]
    return fast


def _lowest(grids: Sequence[FloatArray]) -> float:
    """Return the lowest frequency that is fast, in cycles per frame."""
    return _LOWEST_CYCLES / max(len(grid) for grid in grids)


def _on_grid(frame: IntArray, values: FloatArray) -> FloatArray:
    grid = np.zeros(int(frame[-1] - frame[0]) + 1)
    grid[frame - frame[0]] = values
    return grid


def _runs(frame: IntArray) -> list[slice]:
    """Return where frames follow one another with small gaps at most."""
    if not len(frame):
        return []
    cuts = [0, *(np.flatnonzero(np.diff(frame) > _LARGEST_GAP) + 1).tolist(), len(frame)]
    return [slice(a, b) for a, b in pairwise(cuts)]
