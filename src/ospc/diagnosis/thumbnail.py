"""A frame reduced to a small image: all that a check needs of it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, Image, ImageSize
from ospc.recording.frame import Frame

LONGEST_SIDE = 160
_SMOOTHING_PX = 1.0
_GRADIENT_SMOOTHING_PX = 1.2
_SURROUND_PX = 10.0
_DARK, _BRIGHT = 0.04, 0.97
_CLIP_MARGIN_PX = 2


@dataclass(frozen=True)
class Thumbnail:
    """A small image of a frame.

    Attributes
    ----------
    frame
        Index of the frame.
    grey
        Grey levels in [0, 1], lightly smoothed, shape (h, w).
    surround
        Their mean over a wide neighbourhood, shape (h, w).
    gradient
        Magnitude of the gradient of the grey levels, per small pixel, shape (h, w).
    exposed
        Whether neither the place nor anything near it is black, white or masked, shape (h, w).
    equalised
        The image with its histogram made flat, 8 bit, shape (h, w): nearly the same for every exposure.
    """

    frame: int
    grey: Float32Array
    surround: Float32Array
    gradient: Float32Array
    exposed: BoolArray
    equalised: npt.NDArray[np.uint8]


def thumbnail(frame: Frame) -> Thumbnail:
    """Reduce a frame.

    Raises
    ------
    FrameError
        If its image cannot be read.
    """
    small = reduced(frame.image, frame.max_grey)
    grey = cv2.GaussianBlur(small, (0, 0), _SMOOTHING_PX)
    smoother = cv2.GaussianBlur(grey, (0, 0), _GRADIENT_SMOOTHING_PX)
    gradient = cv2.magnitude(
        cv2.Sobel(smoother, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8),
        cv2.Sobel(smoother, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8),
    )
    clipped = ((small < _DARK) | (small > _BRIGHT)).view(np.uint8)
    if frame.mask is not None:
        clipped |= reduced(frame.mask.astype(np.uint8), 1) < 1
    side = 2 * _CLIP_MARGIN_PX + 1
    near = cv2.dilate(clipped, np.ones((side, side), np.uint8))
    # The square root keeps dark images from falling into a handful of levels before they are spread out.
    levels = cv2.convertScaleAbs(np.sqrt(small), alpha=255.0)
    return Thumbnail(
        frame.index,
        np.asarray(grey, dtype=np.float32),
        np.asarray(cv2.GaussianBlur(small, (0, 0), _SURROUND_PX), dtype=np.float32),
        np.asarray(gradient, dtype=np.float32),
        np.asarray(near == 0),
        np.asarray(cv2.equalizeHist(levels), dtype=np.uint8),
    )


def small_size(size: ImageSize) -> ImageSize:
    """Return width and height of the small image of a frame."""
    scale = min(1.0, LONGEST_SIDE / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def reduced(image: Image, max_grey: int) -> Float32Array:
    """Return the small image of a full one, grey levels in [0, 1], not smoothed."""
    size = small_size((image.shape[1], image.shape[0]))
    small = cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(small / np.float32(max_grey), 0, 1), dtype=np.float32)
