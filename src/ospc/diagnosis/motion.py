"""How far the scene moves across the image, and how far towards or away from the centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ospc.arrays import ImageSize
from ospc.diagnosis.brightness import BrightnessChange
from ospc.diagnosis.thumbnail import small_size

AGES = (4, 8, 16, 32)
"""Distances in frames of the pairs that are compared besides consecutive ones."""

_MIN_FOUND = 0.2
_MIN_PAIRS = 2
_STILL_SMALL_PX = 0.5


@dataclass(frozen=True)
class MotionReport:
    """Motion of the scene in the image.

    Attributes
    ----------
    median_px_per_frame
        Median displacement from one frame to the next in pixels; NaN where nothing could be followed.
    radial_reach
        Radial displacement, in half diagonals, that a tenth of the places exceed, over the time in which most is
        gained and at least a fifth of the image found again.
    found_share
        Share of the image that is well exposed and found again in the next frame.
    still
        Whether the camera stands still.
    """

    median_px_per_frame: float
    radial_reach: float
    found_share: float
    still: bool


def motion(changes: Sequence[BrightnessChange], size: ImageSize) -> MotionReport:
    """Summarise the motion between pairs of frames at all distances.

    Parameters
    ----------
    changes
        Comparisons of frames with the next, and of some with later ones.
    size
        Width and height of the frames in pixels.
    """
    if not changes:
        return MotionReport(float("nan"), 0.0, 0.0, False)
    nearest = [c for c in changes if c.frame1 - c.frame0 == 1] or list(changes)
    reach, far_px = 0.0, float("nan")
    for age in (1, *AGES):
        of_age = [c for c in changes if c.frame1 - c.frame0 == age and c.found >= _MIN_FOUND]
        moved = [c.motion_px for c in of_age if np.isfinite(c.motion_px)]
        if len(of_age) >= _MIN_PAIRS:
            reach = max(reach, float(np.quantile([c.radial_motion for c in of_age], 0.75)))
        if moved:
            far_px = float(np.median(moved))
    per_frame = [c.motion_px for c in nearest if np.isfinite(c.motion_px)]
    unit_px = size[0] / small_size(size)[0]
    return MotionReport(
        float(np.median(per_frame)) if per_frame else float("nan"),
        reach,
        float(np.median([c.found for c in nearest])),
        bool(far_px <= _STILL_SMALL_PX * unit_px),
    )
