"""Dense registration of thumbnails, independent of exposures and response, and helpers for all dense searches."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, ImageSize, read_only
from ospc.correspondence.thumbnail import Thumbnail, magnitude
from ospc.photometry.geometry import pixel_grid
from ospc.settings.registration import (
    MAX_REMAPPED_ROWS,
    MAX_THUMBNAIL_ERROR_PX,
    MIN_EXPOSED_SHARE,
    MIN_REGISTERED_SIDE_PX,
    THUMBNAIL_MARGIN_PX,
    THUMBNAIL_SEARCH_STRIDE_PX,
)

OUTSIDE_PX = 1e4
"""Backward displacement outside the image: so large that no point returns from there."""


class ThumbnailRegistration:
    """Dense inverse search (Kroeger et al. 2016), in OpenCV's implementation, on images with equalised histograms."""

    def __init__(self) -> None:
        preset = cv2.DISOPTICAL_FLOW_PRESET_FAST
        # Refinement would change ln M of a grey bin by only 0.0001. Ending the forward search at half the size would
        # change it by 0.0004, which is enough for false suspicions of camera changes.
        self._there, self._back = optical_flow(preset, finest_scale=0), optical_flow(preset, finest_scale=1)
        self._there.setPatchStride(THUMBNAIL_SEARCH_STRIDE_PX)

    def __call__(self, first: Thumbnail, second: Thumbnail) -> tuple[Float32Array, BoolArray]:
        """Return each pixel's position in the second thumbnail, (h, w, 2), and whether it is found, (h, w)."""
        height, width = first.grey.shape
        places = pixel_places((width, height))
        if min(width, height) < MIN_REGISTERED_SIDE_PX:
            return places, np.ones((height, width), bool)
        forward = self._there.calc(first.equalized, second.equalized, None)
        backward = self._back.calc(second.equalized, first.equalized, None)
        there, error = there_and_back(forward, backward)
        margin = THUMBNAIL_MARGIN_PX
        inside = cv2.inRange(there, (margin, margin, 0, 0), (width - 1 - margin, height - 1 - margin, 0, 0)) > 0
        return there, inside & (error < MAX_THUMBNAIL_ERROR_PX)


def values_at(
    image: Float32Array | npt.NDArray[np.uint8], places: Float32Array, border: int = cv2.BORDER_REPLICATE
) -> Float32Array:
    """Interpolate an image at points (x, y); ``border`` is OpenCV's border mode.

    Shapes (h, w) or (h, w, n) and (..., 2) -> (...) or (..., n).
    """
    shape = (*places.shape[:-1], *image.shape[2:])
    if not places.size:
        return np.empty(shape, np.float32)
    rows, most = places.reshape(len(places), -1, 2), MAX_REMAPPED_ROWS
    parts = (rows[begin : begin + most] for begin in range(0, len(rows), most))
    values = [cv2.remap(image, part, None, cv2.INTER_LINEAR, borderMode=border) for part in parts]
    return np.asarray(np.concatenate(values), dtype=np.float32).reshape(shape)


def rescaled(places: FloatArray, scale: npt.ArrayLike) -> Float32Array:
    """Convert points (x, y) of an image, (..., 2), to one whose size is ``scale`` times as large, along x and y."""
    return np.asarray((places + 0.5) * np.asarray(scale) - 0.5, dtype=np.float32)


def exposed_in_both(first: Thumbnail, second: Thumbnail, there: Float32Array, found: BoolArray) -> BoolArray:
    """Return which pixels of the first were found in the second and are well exposed in both, shape (h, w).

    ``there`` and ``found`` are the results of :class:`ThumbnailRegistration`.
    """
    exposed = values_at(second.exposed.astype(np.float32), there) > MIN_EXPOSED_SHARE
    return np.asarray(found & first.exposed & exposed)


@cache
def pixel_places(size: ImageSize) -> Float32Array:
    """Return the coordinates (x, y) of every pixel of a small image, shape (h, w, 2)."""
    return read_only(pixel_grid(size).astype(np.float32))


def optical_flow(preset: int, finest_scale: int) -> cv2.DISOpticalFlow:
    """Return OpenCV's dense inverse search without refinement, ending at the image halved ``finest_scale`` times."""
    flow = cv2.DISOpticalFlow_create(preset)
    flow.setFinestScale(finest_scale)
    flow.setVariationalRefinementIterations(0)
    return flow


def there_and_back(forward: Float32Array, backward: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return the position of each pixel in the second image, (h, w, 2), and its forward-backward error, (h, w)."""
    there = pixel_places(forward.shape[1::-1]) + forward
    away = (OUTSIDE_PX, OUTSIDE_PX, 0.0, 0.0)
    error = cv2.remap(backward, there, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=away)
    error += forward
    return there, magnitude(error[..., 0], error[..., 1])
