"""Black and white levels inside the scale: grey values at which many pixels pile up, and beyond which there are none.

A sensor or a file format that clips below the end of its scale gives all clipped pixels the same value. If noise,
interpolation or compression act after clipping, the values scatter by a few grey levels.
"""

from __future__ import annotations

import numpy as np

from ospc.arrays import IntArray
from ospc.settings.grey_values import (
    HIGHEST_BLACK,
    LOWEST_SCATTERED_WHITE,
    LOWEST_WHITE,
    MAX_BEYOND_WHITE_SHARE,
    MAX_WHITE_SCATTER,
    MIN_PILE_SHARE,
    MIN_WHITE_CONTRAST,
    WHITE_EDGE,
    WHITE_LEVELS,
    WHITE_NEIGHBOURHOOD,
)
from ospc.settings.sampling import CLIPPED_MARGIN


def black_of(counts: IntArray) -> int | None:
    """Return the lowest grey value if many pixels share it and it is above the end of the scale; else None.

    If few grey values occur, the one next to the end counts as the end. ``counts`` has the number of pixels of each
    grey value, or of each of equal ranges of them; the result is an index of it.
    """
    used, last = np.flatnonzero(counts), len(counts) - 1
    if len(used) < 2:
        return None
    low, second = used[:2].tolist()
    many = counts[low] > MIN_PILE_SHARE * counts.sum()
    return low if many and max(CLIPPED_MARGIN * last, second - low) < low < HIGHEST_BLACK * last else None


def shared_white_of(counts: IntArray) -> int | None:
    """Return the highest grey value if many pixels share it and it is below the end of the scale; else None.

    The argument and the result are those of :func:`black_of`.
    """
    used, last = np.flatnonzero(counts), len(counts) - 1
    if len(used) < 2:
        return None
    high = int(used[-1])
    # If few grey values occur, the next lower ones are farther away.
    below = counts[min(high - round(WHITE_NEIGHBOURHOOD * last), *used[-3:].tolist()) : high].sum()
    many = counts[high] > max(MIN_PILE_SHARE * counts.sum(), below)
    return high if many and LOWEST_WHITE * last < high < last - CLIPPED_MARGIN * last else None


def scattered_white_of(counts: IntArray) -> int | None:
    """Return the lower edge of a narrow peak of the histogram that hardly any values exceed; None without one.

    The argument and the result are those of :func:`black_of`.
    """
    size = -(-len(counts) // WHITE_LEVELS)
    levels = np.add.reduceat(counts, np.arange(0, len(counts), size))
    reaching = np.cumsum(levels[::-1])[::-1]
    top = int(np.flatnonzero(reaching >= MIN_PILE_SHARE * reaching[0])[-1])
    lowest = max(top - MAX_WHITE_SCATTER, 0)
    peak = lowest + int(np.argmax(levels[lowest : top + 1]))
    edges = np.flatnonzero(levels < WHITE_EDGE * levels[peak])
    left = int(edges[edges < peak].max(initial=-1)) + 1
    right = int(edges[edges > peak].min(initial=len(levels))) - 1
    width = right - left + 1
    if width > MAX_WHITE_SCATTER or left < LOWEST_SCATTERED_WHITE * len(levels) or right >= len(levels) - 2:
        return None
    peaked = int(levels[left : right + 1].sum())
    beyond = levels[right + 1 + MAX_WHITE_SCATTER :].sum()
    below = levels[left - width - MAX_WHITE_SCATTER : left - width]
    few_values = np.count_nonzero(below) < len(below) // 2  # each of them is a peak
    clear = levels[peak] > MIN_WHITE_CONTRAST * below.max() and beyond < MAX_BEYOND_WHITE_SHARE * peaked
    return left * size if clear and not few_values and peaked > MIN_PILE_SHARE * reaching[0] else None
