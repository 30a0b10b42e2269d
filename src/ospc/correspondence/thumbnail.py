"""Thumbnails: frames reduced to small images, enough to compare their brightness with that of their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, ImageSize

LONGEST_SIDE_PX = 160
"""Longest side of a thumbnail in pixels: 19 000 places, by which neighbouring frames are compared in a
millisecond."""

_SMOOTHING_PX = 1.0
"""Standard deviation of the smoothing of grey levels, in thumbnail pixels: about the error of the registration."""

_GRADIENT_SMOOTHING_PX = 1.2
"""Standard deviation of the further smoothing before gradients are taken, in thumbnail pixels: a flat place is flat
as far around as registration may be wrong."""

_DARK, _BRIGHT = 0.04, 0.97
"""Grey levels beyond which a place counts as clipped: of a mean over many pixels, some are clipped before it is."""

_CLIP_MARGIN_PX = 2
"""Places this close to a clipped one are not used, in thumbnail pixels: twice the smoothing."""


@dataclass(frozen=True)
class Thumbnail:
    """A small image of a frame.

    Attributes
    ----------
    frame
        Number of the frame.
    grey
        Grey levels in [0, 1], lightly smoothed, shape (h, w).
    gradient
        Magnitude of the gradient of the grey levels, per thumbnail pixel, shape (h, w).
    exposed
        Whether neither the place nor anything near it is black, white or masked, shape (h, w).
    equalized
        The image with its histogram made flat, 8 bit, shape (h, w): nearly the same at every exposure.
    """

    frame: int
    grey: Float32Array
    gradient: Float32Array
    exposed: BoolArray
    equalized: npt.NDArray[np.uint8]


def thumbnail_of(frame: int, image: Float32Array, white: int, mask: BoolArray | None, size: ImageSize) -> Thumbnail:
    """Reduce a frame.

    Parameters
    ----------
    frame
        Its number.
    image
        Grey values at any size, shape (height, width).
    white
        Largest grey value.
    mask
        Where pixels may be used, of any size; None for everywhere.
    size
        Width and height of the frame in pixels.
    """
    small = _reduced(image, size, white)
    grey = cv2.GaussianBlur(small, (0, 0), _SMOOTHING_PX)
    smoother = cv2.GaussianBlur(grey, (0, 0), _GRADIENT_SMOOTHING_PX)
    gradient = cv2.magnitude(
        cv2.Sobel(smoother, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8),
        cv2.Sobel(smoother, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8),
    )
    clipped = ((small < _DARK) | (small > _BRIGHT)).view(np.uint8)
    if mask is not None:
        clipped |= _reduced(mask.astype(np.float32), size, 1) < 1
    side = 2 * _CLIP_MARGIN_PX + 1
    near = cv2.dilate(clipped, np.ones((side, side), np.uint8))
    # The square root leaves dark images more than a handful of levels to equalize.
    levels = cv2.convertScaleAbs(np.sqrt(small), alpha=255.0)
    return Thumbnail(
        frame,
        np.asarray(grey, dtype=np.float32),
        np.asarray(gradient, dtype=np.float32),
        np.asarray(near == 0),
        np.asarray(cv2.equalizeHist(levels), dtype=np.uint8),
    )


def thumbnail_size(size: ImageSize) -> ImageSize:
    """Return width and height of the thumbnail of a frame."""
    scale = min(1.0, LONGEST_SIDE_PX / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _reduced(image: Float32Array, size: ImageSize, white: int) -> Float32Array:
    small = cv2.resize(image, thumbnail_size(size), interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(small / np.float32(white), 0, 1), dtype=np.float32)
