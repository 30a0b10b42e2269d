"""Frame rate and dropped frames from the time stamps, and repeated images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray

_GAP = 1.5
"""Interval over the median one from which frames are missing: half way between one interval and two, since time
stamps jitter."""

_MOST_DROPPED = 1e9
"""Most dropped frames counted: time stamps of two clocks may be decades apart, beyond any integer of a file."""


@dataclass(frozen=True)
class Timing:
    """Time stamps and repeated images.

    Attributes
    ----------
    interval_s
        Median time from one frame to the next; NaN for a single frame.
    gaps
        Number of intervals longer than one and a half of that.
    dropped_frames
        Frames that would fill these gaps.
    duplicate_frames
        Indices of frames whose image is that of the frame before, pixel by pixel; of the frames looked at.
    compared_frames
        Number of frames whose image was compared with the one before.
    """

    interval_s: float
    gaps: int
    dropped_frames: int
    duplicate_frames: tuple[int, ...]
    compared_frames: int


def timing(stamps_s: FloatArray, duplicates: list[int], compared: int) -> Timing:
    """Look at the time stamps of all frames.

    Parameters
    ----------
    stamps_s
        Time stamps in seconds, shape (frames,).
    duplicates
        Indices of frames that repeat the one before.
    compared
        Number of frames compared with the one before.
    """
    interval = np.diff(stamps_s)
    if not len(interval):
        return Timing(float("nan"), 0, 0, tuple(duplicates), compared)
    usual = float(np.median(interval))
    missing = np.rint(interval[interval > _GAP * usual] / usual) - 1 if usual > 0 else np.empty(0)
    return Timing(usual, len(missing), int(min(missing.sum(), _MOST_DROPPED)), tuple(duplicates), compared)
