"""The interface between a calibration method and the engine that runs it."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from ospc.arrays import ImageSize
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.errors import FrameError
from ospc.exposures.lag_change import LagChange
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Change
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.preview import Preview
from ospc.observations import Observations
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.recording.frame import Frame
from ospc.settings.methods import MIN_SIDE_PX


@dataclass(frozen=True)
class Progress:
    """Progress of a method, in figures that are cheap to compute after every frame."""

    pairs: int = 0
    """Number of pairs of frames compared."""
    samples: int = 0
    """Number of correspondences kept so far."""
    response_sigma: float | None = None
    """Largest standard deviation of g over the grey levels, with its scale fixed; None before there is an
    estimate."""
    vignette_sigma: float | None = None
    """Standard deviation of V at the corner; None before there is an estimate."""


def check_can_be_matched(size: ImageSize) -> None:
    """Reject images that are too small to match.

    Raises
    ------
    FrameError
        If a side is shorter than :data:`MIN_SIDE_PX`.
    """
    if min(size) < MIN_SIDE_PX:
        raise FrameError(
            f"images of {size[0]}×{size[1]} pixels are too small; each side needs at least {MIN_SIDE_PX} pixels"
        )


class Method(ABC):
    """Processes frames as they arrive, and returns the current results at any time.

    Exposures are looked up in the table for every estimate, so a lag that is found late applies to all frames.
    Subclasses define :meth:`push`, :attr:`progress` and :meth:`calibration`; with the defaults of the other
    methods, no camera change is detected, and runs can be neither merged nor continued.
    """

    @abstractmethod
    def push(self, frame: Frame, prepared: PreprocessedFrame, exposures: ExposureTable) -> Change | None:
        """Process the next frame, and return the camera change that it proves, if any.

        Memory use must be bounded.

        Raises
        ------
        FrameError
            If the frame's image cannot be read; the method continues as if the frame had not been pushed.
        """

    @property
    @abstractmethod
    def progress(self) -> Progress:
        """The current progress."""

    @abstractmethod
    def calibration(self, exposures: ExposureTable, grey_range: GreyRange = FULL_RANGE) -> Calibration:
        """Return the current calibration for the given grey range; more frames may be pushed afterwards."""

    def compare(self, points: Observations, exposures: ExposureTable) -> Change | None:
        """Process points that two consecutive frames share, and return the camera change that they prove."""
        return None

    def prove_again(self, change: Change, before: FitInputs, exposures: ExposureTable) -> Change | None:
        """Prove a change again with the complete fit to the frames before it; None if the camera has not changed.

        The method then continues with that fit.
        """
        return change

    def agrees_with(self, change: LagChange, exposures: ExposureTable) -> bool:
        """Return whether the pairs since a change of the lag, proven by brightness alone, may have the new lag."""
        return True

    @property
    def longest_pause(self) -> int:
        """Maximum number of frames that may be skipped now."""
        return sys.maxsize

    def end_threads(self) -> None:
        """End the method's own threads; the next frame starts them again."""
        return

    def since(self, number: int) -> Method:
        """Return a method that continues with the observations from a frame on; this one is not used any more."""
        return self

    def inputs(self, exposures: ExposureTable, grey_range: GreyRange = FULL_RANGE) -> FitInputs | None:
        """Return the fit with its data, for checks of the exposures and for merging; None if not supported."""
        return None

    def preview(self, exposures: ExposureTable) -> Preview | None:
        """Return quick estimates; None before there are any, or if not supported."""
        return None

    def state(self) -> Any:
        """Return a dataclass of the settings' ``state_type`` for :meth:`restore`; None if not supported."""
        return None

    def restore(self, state: Any, frames: int) -> None:
        """Continue from a state after this many frames.

        Raises
        ------
        FormatError, ValueError
            If its parts are inconsistent.
        """
        raise ValueError("this method cannot continue from a state")

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Numbers of the frames to pass to :meth:`replay` after a state was restored."""
        return frozenset()

    def replay(self, prepared: PreprocessedFrame) -> None:
        """Process a frame again that was pushed before the state was saved."""
        return
