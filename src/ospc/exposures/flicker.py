"""Detect flicker: periodic brightness changes that the exposure does not explain, as from mains-powered lamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.numerics.robust import robust_scale
from ospc.settings.exposures import (
    FLICKER_CHANCE,
    FLICKER_CLIP_SIGMAS,
    FOURIER_OVERSAMPLING,
    MAX_FLICKER_SHARE,
    MAX_PHASE_GAP_FRAMES,
    MIN_FAST_PERIODS,
    MIN_FLICKER_FRAMES,
    MIN_FLICKER_LOG,
    MIN_FLICKER_SCATTER_LOG,
    MIN_FLICKER_SHARE,
    MIN_WAVE_PERIODS,
)


@dataclass(frozen=True)
class Flicker:
    """A periodic brightness change, with its frequency as sampled by the frames, at most 0.5.

    ``log_amplitude`` is the amplitude of the change from one frame to the next, in ln of the grey level. ``share`` is
    its share of the energy of the fast unexplained changes.
    """

    cycles_per_frame: float
    log_amplitude: float
    share: float

    @property
    def brightness_amplitude(self) -> float:
        """Relative amplitude of the brightness: half its range over its mean."""
        return self.log_amplitude / float(2 * np.sin(np.pi * self.cycles_per_frame))


def find_flicker(frame: IntArray, change: FloatArray) -> Flicker | None:
    """Find the strongest periodic component of unexplained changes of ln brightness between frames.

    ``frame`` holds the increasing frame index of each change; the phase is fitted anew after a long gap. Both arrays
    have shape (n,). Returns None unless the strongest frequency with at least four periods in the observed time is
    significant (Fisher's test for the largest peak of a periodogram).
    """
    if not in_long_runs(frame).any():
        return None
    value = change - np.median(change)
    limit = FLICKER_CLIP_SIGMAS * (robust_scale(value) + MIN_FLICKER_SCATTER_LOG)
    value = np.clip(value, -limit, limit)
    frequency = _strongest_frequency(frame, value, MIN_FAST_PERIODS)
    fitted = value - without_waves(frame, value, [frequency])
    share = min(float(np.var(fitted)) / max(float(np.var(fast_part(frame, value))), 1e-12), 1.0)
    # Probability that the largest of ``count`` independent frequencies of white noise has this share of the power.
    count = len(value) // 2
    chance = count * (1 - min(share, MAX_FLICKER_SHARE)) ** max(count / len(_runs(frame)) - 1, 1.0)
    amplitude = float(np.sqrt(2) * np.std(fitted))
    if amplitude < MIN_FLICKER_LOG or share < MIN_FLICKER_SHARE or chance > FLICKER_CHANCE:
        return None
    return Flicker(frequency, amplitude, share)


def strongest_wave(frame: IntArray, change: FloatArray) -> tuple[float, float] | None:
    """Return the strongest frequency of changes, in cycles per frame, and its share of their energy.

    Frequencies with fewer than two periods in a run of frames are ignored. Returns None if no run is long enough.
    """
    energy = float(np.sum(change**2))
    if energy <= 0 or not in_long_runs(frame).any():
        return None
    frequency = _strongest_frequency(frame, change, MIN_WAVE_PERIODS)
    rest = without_waves(frame, change, [frequency])
    return frequency, 1 - float(np.sum(rest**2)) / energy


def waves(frame: IntArray, cycles_per_frame: Sequence[float]) -> FloatArray:
    """Return a cosine and a sine of each frequency per run of frames, zero outside the run, shape (n, columns)."""
    angle = 2 * np.pi * np.outer(frame, cycles_per_frame)
    everywhere, columns = np.column_stack([np.cos(angle), np.sin(angle)]), []
    for run in _runs(frame):
        inside = np.zeros((len(frame), 1))
        inside[run] = 1
        columns.append(everywhere * inside)
    return np.column_stack(columns)


def without_waves(frame: IntArray, change: FloatArray, cycles_per_frame: Sequence[float]) -> FloatArray:
    """Return the changes minus fitted waves of these frequencies, fitted per run of frames, shape (n,)."""
    rest = change.copy()
    for run in _runs(frame):
        columns = waves(frame[run], cycles_per_frame)
        rest[run] -= columns @ np.linalg.lstsq(columns, change[run], rcond=None)[0]
    return rest


def in_long_runs(frame: IntArray) -> BoolArray:
    """Return which values belong to runs of frames long enough to show flicker, shape (n,)."""
    long = np.zeros(len(frame), dtype=bool)
    for run in _runs(frame):
        long[run] = run.stop - run.start >= MIN_FLICKER_FRAMES
    return long


def fast_part(frame: IntArray, change: FloatArray) -> FloatArray:
    """Return the changes without frequencies that have only a few periods in a run of frames, shape (n,)."""
    fast = np.zeros(len(change))
    for run in _runs(frame):
        grid = _on_grid(frame[run], change[run] - change[run].mean())
        spectrum = np.fft.rfft(grid)
        spectrum[np.fft.rfftfreq(len(grid)) < MIN_FAST_PERIODS / len(grid)] = 0
        fast[run] = np.fft.irfft(spectrum, len(grid))[frame[run] - frame[run.start]]
    return fast


def _strongest_frequency(frame: IntArray, values: FloatArray, periods: int) -> float:
    """Return the strongest frequency, in cycles per frame, with at least this many periods in the longest run."""
    grids = [_on_grid(frame[run], values[run]) for run in _runs(frame)]
    longest = max(len(grid) for grid in grids)
    length = FOURIER_OVERSAMPLING * longest
    power = sum((np.abs(np.fft.rfft(grid, length)) ** 2 for grid in grids), np.zeros(length // 2 + 1))
    frequencies = np.fft.rfftfreq(length)
    return float(frequencies[np.argmax(np.where(frequencies >= periods / longest, power, 0.0))])


def _on_grid(frame: IntArray, values: FloatArray) -> FloatArray:
    """Return the values with zeros inserted for missing frames."""
    grid = np.zeros(int(frame[-1] - frame[0]) + 1)
    grid[frame - frame[0]] = values
    return grid


def _runs(frame: IntArray) -> list[slice]:
    """Return the runs of frames without large gaps."""
    if not len(frame):
        return []
    cuts = [0, *(np.flatnonzero(np.diff(frame) > MAX_PHASE_GAP_FRAMES) + 1).tolist(), len(frame)]
    return [slice(a, b) for a, b in pairwise(cuts)]
