"""How far the scene moves across the image, and how far towards or away from the centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ospc.exposures.brightness import BrightnessChange
from ospc.methods.inputs import FitInputs


@dataclass(frozen=True)
class MotionReport:
    """Motion of the scene in the image.

    Attributes
    ----------
    median_px_per_frame
        Median displacement from one frame to the next in pixels; NaN where nothing could be followed.
    radial_reach
        Radial displacement, in half diagonals, of the scene points that tell the vignette.
    found_share
        Share of the image that is well exposed and found again in the next frame; NaN where none was compared.
    still
        Whether the camera stands still.
    """

    median_px_per_frame: float
    radial_reach: float
    found_share: float
    still: bool


def motion(changes: Sequence[BrightnessChange], inputs: FitInputs | None) -> MotionReport:
    """Summarise the motion between consecutive frames, and over the scene points of a run."""
    displacement = [c.motion_px for c in changes if np.isfinite(c.motion_px)]
    still = inputs is not None and inputs.standing_still
    moves = inputs is not None and inputs.observations is not None and not still
    return MotionReport(
        float(np.median(displacement)) if displacement else float("nan"),
        inputs.observations.radial_reach if moves and inputs is not None and inputs.observations is not None else 0.0,
        float(np.median([c.found for c in changes])) if changes else float("nan"),
        still,
    )
