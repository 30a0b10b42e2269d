"""Dense registration of thumbnails, whatever the exposures and the response are; and what all dense search shares."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, ImageSize
from ospc.correspondence.thumbnail import Thumbnail, magnitude
from ospc.photometry.geometry import pixel_grid
from ospc.settings.correspondence import (
    MAX_THUMBNAIL_ERROR_PX,
    MIN_EXPOSED_SHARE,
    MIN_REGISTERED_SIDE_PX,
    THUMBNAIL_MARGIN_PX,
    THUMBNAIL_SEARCH_STRIDE_PX,
)

OUTSIDE_PX = 1e4
"""Displacement on the way back from outside the image: so far that no place comes back from there."""


class ThumbnailRegistration:
    """Dense inverse search (Kroeger et al. 2016), OpenCV's implementation, on images with equalized histograms."""

    def __init__(self) -> None:
        preset = cv2.DISOPTICAL_FLOW_PRESET_FAST
        # Refined, ln M of a grey bin would change by 0.0001. Down to half the size only, it would change by 0.0004,
        # which is enough to suspect changes of the camera where there are none.
        self._there, self._back = optical_flow(preset, finest_scale=0), optical_flow(preset, finest_scale=1)
        self._there.setPatchStride(THUMBNAIL_SEARCH_STRIDE_PX)

    def __call__(self, first: Thumbnail, second: Thumbnail) -> tuple[Float32Array, BoolArray]:
        """Return where every place of the first is in the second, (h, w, 2), and whether it was found, (h, w)."""
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


def values_at(image: Float32Array | npt.NDArray[np.uint8], places: Float32Array) -> Float32Array:
    """Return the values of an image, (h, w) or (h, w, n), at places (x, y), (..., 2), interpolated."""
    values = cv2.remap(image, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float32)


def rescaled(places: FloatArray, scale: npt.ArrayLike) -> Float32Array:
    """Return places (x, y) of an image, (..., 2), in one whose size is ``scale`` times as large, along x and y."""
    return np.asarray((places + 0.5) * np.asarray(scale) - 0.5, dtype=np.float32)


def exposed_in_both(first: Thumbnail, second: Thumbnail, there: Float32Array, found: BoolArray) -> BoolArray:
    """Return which places of the first were found in the second and are well exposed in both, shape (h, w).

    ``there`` and ``found`` are what :class:`ThumbnailRegistration` returned.
    """
    exposed = values_at(second.exposed.astype(np.float32), there) > MIN_EXPOSED_SHARE
    return np.asarray(found & first.exposed & exposed)


@cache
def pixel_places(size: ImageSize) -> Float32Array:
    """Return the coordinates (x, y) of every pixel of a small image, shape (h, w, 2)."""
    places = pixel_grid(size).astype(np.float32)
    places.setflags(write=False)
    return places


def optical_flow(preset: int, finest_scale: int) -> cv2.DISOpticalFlow:
    """Return OpenCV's dense inverse search, down to the image halved ``finest_scale`` times, without refinement."""
    flow = cv2.DISOpticalFlow_create(preset)
    flow.setFinestScale(finest_scale)
    flow.setVariationalRefinementIterations(0)
    return flow


def there_and_back(forward: Float32Array, backward: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return where every place is found, (h, w, 2), and how far there and back ends from it, (h, w), in pixels."""
    there = pixel_places(forward.shape[1::-1]) + forward
    away = (OUTSIDE_PX, OUTSIDE_PX, 0.0, 0.0)
    error = cv2.remap(backward, there, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=away)
    error += forward
    return there, magnitude(error[..., 0], error[..., 1])
