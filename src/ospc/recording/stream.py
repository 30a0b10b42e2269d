"""Frames from any iterable."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from ospc.arrays import Image
from ospc.errors import ExposureError, FrameError
from ospc.recording.frame import Frame

Item: TypeAlias = Frame | tuple[Image, float] | tuple[Image, float, float]
"""A frame, an image with its exposure in ms, or an image with its exposure in ms and time stamp in s."""


def frames_of(items: Iterable[Item], *, max_grey: int | None = None) -> Iterator[Frame]:
    """Yield frames from any iterable; none is kept.

    Parameters
    ----------
    items
        Frames, or tuples ``(image, exposure_ms)`` or ``(image, exposure_ms, stamp_s)`` with grey images of shape
        (height, width), uint8 or uint16.
    max_grey
        Largest grey value of the images; required if they have more than 8 bits.

    Raises
    ------
    FrameError
        If an item is none of these, or an image is not grey.
    ExposureError
        If an exposure is not finite and positive.

    Examples
    --------
    >>> import numpy as np
    >>> [frame.exposure_ms for frame in frames_of([(np.zeros((4, 6), np.uint8), 5.0)])]
    [5.0]
    """
    for index, item in enumerate(items):
        yield replace(item, index=index) if isinstance(item, Frame) else _frame(item, index, max_grey)


def _frame(item: Any, index: int, max_grey: int | None) -> Frame:
    if not isinstance(item, tuple | list) or len(item) not in (2, 3):
        raise FrameError(f"item {index}: must be a frame, (image, exposure_ms) or (image, exposure_ms, stamp_s)")
    image = np.asarray(item[0])
    try:
        exposure_ms, stamp_s = float(item[1]), float(item[2]) if len(item) == 3 else float(index)
    except (TypeError, ValueError):
        raise ExposureError(f"item {index}: exposure and time stamp must be numbers") from None
    if not 0 < exposure_ms < np.inf:
        raise ExposureError(f"item {index}: exposure {exposure_ms} ms is not a positive number")
    if image.dtype != np.uint8 and max_grey is None:
        raise FrameError(
            f"item {index}: has grey values of type {image.dtype}; state max_grey, the largest value of the sensor"
        )
    return Frame.of_array(image, exposure_ms, index=index, stamp_s=stamp_s, max_grey=max_grey)
