"""Detection of a stationary camera, for which every pixel is a scene point observed in all frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.correspondence.static_series import StaticSeries
from ospc.recording.frame import Frame
from ospc.settings.methods import (
    FAR_MOTION,
    MAX_MOTIONS,
    MIN_FAR_PAIRS,
    MIN_MOVING_PAIRS,
    MOVING_FACTOR,
    MOVING_SHARE,
    UNDECIDED_PAIRS,
)


@dataclass
class StationaryCamera:
    """Decides from the displacements between frames whether the camera is stationary.

    Until the camera clearly moves, the grey values of some pixels are kept as observations.
    """

    stationary_px: float
    """Median displacement in pixels up to which a camera counts as stationary."""
    series: StaticSeries | None
    """The kept grey values; None once the camera moved."""
    motions: list[float] = field(default_factory=list, repr=False)
    """The latest displacements in pixels."""

    def observe(self, frame: Frame) -> None:
        """Keep the grey values of a frame, unless the camera has moved."""
        if self.series is None:
            return
        self.series.observe(frame)
        motion_px = float(np.median(self.motions)) if self.motions else 0.0
        moves = len(self.motions) >= MIN_MOVING_PAIRS and motion_px > MOVING_FACTOR * self.stationary_px
        # It may rest most of the time, like a robot arm, or have been moved only once.
        far_px = FAR_MOTION * max(frame.image.shape)
        moves |= sum(motion > far_px for motion in self.motions) >= MIN_FAR_PAIRS
        if moves or (len(self.motions) >= UNDECIDED_PAIRS and not self.is_stationary):
            self.series = None

    def add_motion(self, motion_px: float) -> None:
        """Add the displacement between two frames, NaN if unknown."""
        if np.isfinite(motion_px):
            self.motions = [*self.motions, motion_px][-MAX_MOTIONS:]

    @property
    def is_stationary(self) -> bool:
        """Whether the camera has never clearly moved and does not move now."""
        if self.series is None or not self.motions:
            return False
        typical_px, largest_px = np.quantile(self.motions, [0.5, 1 - MOVING_SHARE])
        # A pan-tilt unit rests most of the time.
        return bool(typical_px <= self.stationary_px and largest_px <= MOVING_FACTOR * self.stationary_px)

    @property
    def used_series(self) -> StaticSeries | None:
        """The series of grey values used instead of pairs of frames; None if the camera moves."""
        return self.series if self.is_stationary else None
