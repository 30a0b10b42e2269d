"""Estimate the response from windows across edges between two even regions of one image.

A pixel on the edge covers a part of each region. Its irradiance is a mixture of theirs, but its grey level is not the
same mixture of their grey levels unless the response is linear. The prior p of responses is
:mod:`~ospc.unknown_exposures.single_image.response_prior`.

Lin, Gu, Yamazaki and Shum, "Radiometric calibration from a single image", 2004. An edge pixel has the irradiance
α I₁ + (1 − α) I₂ in every channel, with the same α. Its irradiance therefore lies on the line between the region
colours, and g must map its colour onto that line:

    d = |(g(M₁) − g(M₂)) × (g(Mₚ) − g(M₂))| / |g(M₁) − g(M₂)|²,     g* = argmin  mean d − λ ln p(g)

All channels share one response. Deviation from the publication: it does not divide by the length of the line a second
time. Its distances become small for any g that is close to zero up to the brightest grey levels, and only a prior
learned from real cameras prevents this solution; d relative to the length of the line does not have this problem. The
published thresholds for windows could not be verified. As in an independent implementation (Lalonde), d is the mean
over all edge pixels, and the prior counts once per channel.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import BoolArray, FloatArray, Image, IntArray
from ospc.errors import NotObservableError, counted
from ospc.photometry.response import Response
from ospc.settings.single_image import (
    BETWEEN_MARGIN,
    CANNY_THRESHOLDS,
    COLOUR_PRIOR_WEIGHT,
    EDGE_BLEND_PX,
    EDGE_SPACING_PX,
    EDGE_WINDOW_PX,
    MAX_EDGE_WINDOWS,
    MAX_REGION_SPREAD,
    MIN_EDGE_CONTRAST,
    MIN_EDGE_PIXELS,
    MIN_PATCHES,
    MIN_REGION_PIXELS,
    MIN_SQUARED_LENGTH,
    UNCLIPPED_REGION_8_BIT,
)
from ospc.unknown_exposures.single_image.response_prior import response_prior


@dataclass(frozen=True)
class EdgePatches:
    """Windows across edges, with grey levels in [0, 255] of one or three channels.

    ``first`` and ``second`` are the means of the two regions, shape (n, channels). ``edge`` contains the grey levels
    of the edge pixels of all windows, shape (m, channels), and ``window`` their window indices, shape (m,).
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
        if len(found) < MIN_PATCHES:
            raise NotObservableError(
                f"only {counted(len(found), 'edge')} between even regions found, but a response needs "
                f"{MIN_PATCHES}; use an image of distinct, evenly lit surfaces"
            )
        first, second, edges = zip(*found, strict=True)
        window = np.repeat(np.arange(len(edges)), [len(edge) for edge in edges])
        return cls(np.array(first), np.array(second), np.concatenate(edges), window)

    def linearised(self, curve: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return g of the two regions of every edge pixel, and of the pixel itself, shape (m, channels) each."""
        levels = np.arange(curve.size) * (255 / (curve.size - 1))
        first, second, edge = (np.interp(grey, levels, curve) for grey in (self.first, self.second, self.edge))
        return first[self.window], second[self.window], edge


def _patches_in(image: Image) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return the means of both regions and the edge pixels of every valid window."""
    planes = image if image.ndim == 3 else image[:, :, None]
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
    strength = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    strength[cv2.Canny(grey, *CANNY_THRESHOLDS) == 0] = 0
    half, (height, width) = EDGE_WINDOW_PX // 2, grey.shape
    corners = []
    for y in range(half, height - half - EDGE_SPACING_PX, EDGE_SPACING_PX):
        for x in range(half, width - half - EDGE_SPACING_PX, EDGE_SPACING_PX):
            cell = strength[y : y + EDGE_SPACING_PX, x : x + EDGE_SPACING_PX]
            place = int(cell.argmax())
            if cell.flat[place] > 0:
                dy, dx = divmod(place, EDGE_SPACING_PX)
                corners.append((float(cell.flat[place]), y + dy - half, x + dx - half))
    taken: BoolArray = np.zeros(grey.shape, dtype=bool)
    found = []
    for _, y, x in sorted(corners, reverse=True)[:MAX_EDGE_WINDOWS]:
        window = (slice(y, y + EDGE_WINDOW_PX), slice(x, x + EDGE_WINDOW_PX))
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
    kernel = np.ones((2 * EDGE_BLEND_PX + 1, 2 * EDGE_BLEND_PX + 1), np.uint8)
    second = cv2.erode(bright, kernel) > 0
    first = cv2.dilate(bright, kernel) == 0
    if min(np.count_nonzero(first), np.count_nonzero(second)) < MIN_REGION_PIXELS:
        return None
    means = np.array([pixels[region].mean(axis=0) for region in (first, second)])
    spreads = np.array([pixels[region].std(axis=0) for region in (first, second)])
    low, high = means.min(axis=0), means.max(axis=0)
    even = np.max(spreads) <= MAX_REGION_SPREAD and np.min(high - low) >= MIN_EDGE_CONTRAST
    if not even or low.min() < UNCLIPPED_REGION_8_BIT[0] or high.max() > UNCLIPPED_REGION_8_BIT[1]:
        return None
    edge = pixels[~first & ~second]
    margin = BETWEEN_MARGIN * (high - low)
    edge = edge[np.all((edge > low + margin) & (edge < high - margin), axis=1)]
    return None if len(edge) < MIN_EDGE_PIXELS else (means[0], means[1], edge)


def edge_colour_distance(patches: EdgePatches, curve: FloatArray) -> float:
    """Return the mean distance d of edge colours from the lines between their regions; g at equidistant greys."""
    first, second, edge = patches.linearised(curve)
    line, offset = first - second, edge - second
    area = np.linalg.norm(np.cross(line, offset), axis=1)
    return float(np.mean(area / np.maximum(np.sum(line**2, axis=1), MIN_SQUARED_LENGTH)))


def edge_colour_response(patches: EdgePatches) -> Response:
    """Return the response that maps edge colours onto the lines between the colours of their regions.

    NotObservableError if the patches have no colours.
    """
    if patches.first.shape[1] != 3:
        raise NotObservableError("this needs the colours of edges, but the image is grey")
    return response_prior().most_likely(
        lambda curve: edge_colour_distance(patches, curve), COLOUR_PRIOR_WEIGHT, "edge-colours"
    )
