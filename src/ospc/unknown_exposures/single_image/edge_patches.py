"""Windows across the edge of two even regions: what Lin 2004, Lin and Zhang 2005 and Mo 2019 read.

A pixel on the edge sees both regions, each on a part of its area. Its irradiance is between theirs, and its grey
level is not where it would be on a line.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import BoolArray, FloatArray, Image, IntArray
from ospc.errors import NotObservableError, counted

_SIDE_PX = 15
"""Side of a window, as published."""

_BLEND_PX = 2
"""Pixels up to this distance from the edge see both regions."""

_SPACING_PX = 8
"""Windows begin at most one in a cell of this side, on the pixel of the strongest gradient."""

_CANNY = (40, 100)
"""Thresholds of the edge detector, in grey levels."""

_MOST_SPREAD, _LEAST_CONTRAST = 4.0, 20.0
"""Largest standard deviation within a region, and least distance of the regions, in grey levels of each channel: the
error of the means must be small against what the curve bends in between."""

_FEWEST_REGION, _FEWEST_EDGE = 20, 8
"""Pixels that a region and an edge have at least: with fewer, their means and histograms are noise."""

_BETWEEN = 0.03
"""Part of the distance of the regions by which an edge pixel stays within them: nearer ones see one region only."""

_CLIPPED = (3, 252)
"""Grey levels outside of which a region may be clipped."""

_MOST_WINDOWS = 1500
"""Windows of an image that are read, the strongest edges first: more take time, and do not make the curve better."""

_FEWEST_PATCHES = 5
"""Patches that a curve is estimated from at least."""


@dataclass(frozen=True)
class EdgePatches:
    """Windows across edges, with grey levels in [0, 255] of one channel, or of three.

    ``first`` and ``second`` are means of the two regions, shape (n, channels); ``edge`` are the grey levels of the
    edge pixels of all windows, shape (m, channels), and ``window`` is the window of each of them, shape (m,).
    """

    first: FloatArray
    second: FloatArray
    edge: FloatArray
    window: IntArray

    @classmethod
    def of(cls, images: Iterable[Image]) -> EdgePatches:
        """Find the windows in 8-bit images of shape (height, width) or (height, width, 3).

        NotObservableError if there are too few.
        """
        found = [patch for image in images for patch in _patches_in(image)]
        if len(found) < _FEWEST_PATCHES:
            raise NotObservableError(
                f"only {counted(len(found), 'edge')} between even regions found, of the {_FEWEST_PATCHES} that a "
                f"response takes; use an image of distinct, evenly lit surfaces"
            )
        first, second, edges = zip(*found, strict=True)
        window = np.repeat(np.arange(len(edges)), [len(edge) for edge in edges])
        return cls(np.array(first), np.array(second), np.concatenate(edges), window)

    def linearised(self, curve: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return g of both regions for every edge pixel, and g of the pixel, shape (m, channels) each."""
        levels = np.arange(curve.size) * (255 / (curve.size - 1))
        first, second, edge = (np.interp(grey, levels, curve) for grey in (self.first, self.second, self.edge))
        return first[self.window], second[self.window], edge


def _patches_in(image: Image) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return means of both regions and the edge pixels of every window that qualifies."""
    planes = image if image.ndim == 3 else image[:, :, None]
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    strength = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    strength[cv2.Canny(grey, *_CANNY) == 0] = 0
    half, (height, width) = _SIDE_PX // 2, grey.shape
    corners = []
    for y in range(half, height - half - _SPACING_PX, _SPACING_PX):
        for x in range(half, width - half - _SPACING_PX, _SPACING_PX):
            cell = strength[y : y + _SPACING_PX, x : x + _SPACING_PX]
            place = int(cell.argmax())
            if cell.flat[place] > 0:
                dy, dx = divmod(place, _SPACING_PX)
                corners.append((float(cell.flat[place]), y + dy - half, x + dx - half))
    taken: BoolArray = np.zeros(grey.shape, dtype=bool)
    found = []
    for _, y, x in sorted(corners, reverse=True)[:_MOST_WINDOWS]:
        window = (slice(y, y + _SIDE_PX), slice(x, x + _SIDE_PX))
        if taken[window].mean() > 0.5:
            continue
        patch = _patch(grey[window], planes[window].astype(np.float64))
        if patch is not None:
            taken[window] = True
            found.append(patch)
    return found


def _patch(grey: Image, pixels: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Split a window at Otsu's threshold; None if it is not an edge between two even regions."""
    _, bright = cv2.threshold(grey, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    kernel = np.ones((2 * _BLEND_PX + 1, 2 * _BLEND_PX + 1), np.uint8)
    second = cv2.erode(bright, kernel) > 0
    first = cv2.dilate(bright, kernel) == 0
    if min(np.count_nonzero(first), np.count_nonzero(second)) < _FEWEST_REGION:
        return None
    means = np.array([pixels[region].mean(axis=0) for region in (first, second)])
    spreads = np.array([pixels[region].std(axis=0) for region in (first, second)])
    low, high = means.min(axis=0), means.max(axis=0)
    even = np.max(spreads) <= _MOST_SPREAD and np.min(high - low) >= _LEAST_CONTRAST
    if not even or low.min() < _CLIPPED[0] or high.max() > _CLIPPED[1]:
        return None
    edge = pixels[~first & ~second]
    margin = _BETWEEN * (high - low)
    edge = edge[np.all((edge > low + margin) & (edge < high - margin), axis=1)]
    return None if len(edge) < _FEWEST_EDGE else (means[0], means[1], edge)
