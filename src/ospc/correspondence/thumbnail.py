"""Thumbnails: small images of frames for comparing the brightness of neighbouring frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, ImageSize
from ospc.photometry.grey_range import GreyRange
from ospc.recording.frame import Frame
from ospc.settings.registration import (
    BRIGHTEST_EXPOSED_MEAN,
    DARKEST_EXPOSED_MEAN,
    LEAST_THUMBNAIL_PIXELS,
    THUMBNAIL_CLIP_MARGIN_PX,
    THUMBNAIL_GRADIENT_SMOOTHING_PX,
    THUMBNAIL_SIDE_PX,
    THUMBNAIL_SMOOTHING_PX,
)


@dataclass(frozen=True)
class Thumbnail:
    """A small image of a frame."""

    frame: int
    """Number of the frame."""
    grey: Float32Array
    """Grey levels in [0, 1], lightly smoothed, shape (h, w)."""
    gradient: Float32Array
    """Magnitude of the gradient of the grey levels, per thumbnail pixel, shape (h, w)."""
    exposed: BoolArray
    """Whether no pixel in the neighbourhood is black, white or masked, shape (h, w)."""
    equalized: npt.NDArray[np.uint8]
    """The image after histogram equalisation, 8 bit, shape (h, w): nearly the same at every exposure."""
    frame_width_px: int
    """Width of the frame."""


def thumbnail_of(frame: Frame, image: Float32Array, size: ImageSize, grey_range: GreyRange) -> Thumbnail:
    """Reduce a frame of a size to a thumbnail, given the currently known grey range.

    ``image`` contains the grey values of the frame, possibly already reduced.
    """
    small = _reduced(image, size, frame.max_grey)
    grey = cv2.GaussianBlur(small, (0, 0), THUMBNAIL_SMOOTHING_PX)
    darkest, brightest = grey_range.grey((DARKEST_EXPOSED_MEAN, BRIGHTEST_EXPOSED_MEAN))
    clipped = ((small < darkest) | (small > brightest)).view(np.uint8)
    if frame.mask is not None:
        clipped |= _reduced(frame.mask.astype(np.float32), size, 1) < 1
    side = 2 * THUMBNAIL_CLIP_MARGIN_PX + 1
    near = cv2.dilate(clipped, np.ones((side, side), np.uint8))
    # The square root keeps more levels of dark images for equalisation.
    levels = cv2.convertScaleAbs(np.sqrt(small), alpha=255.0)
    gradient = gradient_magnitude(cv2.GaussianBlur(grey, (0, 0), THUMBNAIL_GRADIENT_SMOOTHING_PX))
    return Thumbnail(frame.index, grey, gradient, near == 0, cv2.equalizeHist(levels), size[0])


def gradient_magnitude(image: Float32Array) -> Float32Array:
    """Return the magnitude of an image's gradient per pixel."""
    along_x, along_y = (cv2.Sobel(image, cv2.CV_32F, dx, 1 - dx, ksize=3, scale=1 / 8) for dx in (1, 0))
    return magnitude(along_x, along_y)


def magnitude(x: Float32Array, y: Float32Array) -> Float32Array:
    """Return the lengths of vectors."""
    # The rounding of cv2.magnitude depends on the alignment of its arrays, so results would differ between runs.
    return np.asarray(np.sqrt(x * x + y * y))


def thumbnail_size(size: ImageSize) -> ImageSize:
    """Return width and height of the thumbnail of a frame."""
    by_pixels = math.sqrt(LEAST_THUMBNAIL_PIXELS / (size[0] * size[1]))
    scale = min(1.0, max(THUMBNAIL_SIDE_PX / max(size), by_pixels))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _reduced(image: Float32Array, size: ImageSize, white: int) -> Float32Array:
    small = cv2.resize(image, thumbnail_size(size), interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(small / np.float32(white), 0, 1), dtype=np.float32)
