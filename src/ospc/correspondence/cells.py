"""Selection of points that are spread evenly over cells, such as ranges of grey level and radius."""

from __future__ import annotations

import numpy as np

from ospc.arrays import IntArray


def ranks_in_cells(cell: IntArray, order: IntArray) -> IntArray:
    """Return the rank of each point in its cell, shape (n,).

    ``order`` sorts the points by their cell, and within it as they are ranked. The points of the lowest ranks are one
    of each cell, then a second one of each, and so on.
    """
    count = np.bincount(cell)
    rank = np.empty(len(cell), np.int64)
    rank[order] = np.arange(len(cell)) - np.repeat(np.cumsum(count) - count, count)
    return rank
