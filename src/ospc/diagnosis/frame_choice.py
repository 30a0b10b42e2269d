"""Which frames of a recording are looked at: short runs of consecutive ones, where the exposure changes most."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray

RUN_FRAMES = 40
"""Shortest length of one of several runs: enough to see if brightness follows, and the scene cross the image."""

_LARGEST_JUMP = 0.5


def choose_runs(exposures_ms: FloatArray, frames: int) -> tuple[range, ...]:
    """Choose runs of consecutive frames, in order, none overlapping.

    The recording is cut into equal stretches; in each, the run is taken in which the logarithm of the exposure bends
    most. A steady change looks the same whichever frame an exposure is written beside; a bend does not.

    Parameters
    ----------
    exposures_ms
        Exposure of every frame, shape (frames,).
    frames
        Most frames to look at in all.

    Returns
    -------
    tuple of range
        Indices of frames; the whole recording as one run where it is no longer than ``frames``.
    """
    count = len(exposures_ms)
    if count <= frames:
        return (range(count),)
    runs = max(1, frames // RUN_FRAMES)
    length = frames // runs
    change = np.diff(np.log(exposures_ms), prepend=np.log(exposures_ms[0]))
    bend = np.abs(np.diff(np.clip(change, -_LARGEST_JUMP, _LARGEST_JUMP), prepend=0.0))
    total = np.concatenate([[0.0], np.cumsum(bend)])
    chosen = []
    for number in range(runs):
        start, end = number * count // runs, (number + 1) * count // runs
        starts = np.arange(start, max(start, end - length) + 1)
        gain = total[np.minimum(starts + length, count)] - total[starts]
        # Of equally good runs the one in the middle: a recording's ends are least like the rest of it.
        best = starts[np.flatnonzero(gain >= gain.max() * 0.99)]
        first = int(best[len(best) // 2])
        chosen.append(range(first, min(first + length, end)))
    return tuple(chosen)
