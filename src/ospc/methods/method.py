"""What every calibration method offers to the engine that drives it."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any, Protocol

from ospc.arrays import ImageSize
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.errors import FrameError
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Change
from ospc.methods.preview import Preview
from ospc.methods.summary import FitInputs
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.recording.frame import Frame
from ospc.settings.methods import MIN_SIDE_PX


@dataclass(frozen=True)
class Progress:
    """How far a method has come, in figures that are cheap to ask for after every frame.

    Attributes
    ----------
    pairs, samples
        Pairs of frames compared, and correspondences kept so far.
    response_sigma
        Standard deviation of g, its scale held, at the grey level where it is largest; None before there is an
        estimate.
    vignette_sigma
        Standard deviation of V at the corner; None before there is an estimate.
    """

    pairs: int = 0
    samples: int = 0
    response_sigma: float | None = None
    vignette_sigma: float | None = None


def check_size(size: ImageSize) -> None:
    """Refuse images in which hardly anything could be found again.

    Raises
    ------
    FrameError
        If a side is shorter than :data:`MIN_SIDE_PX`.
    """
    if min(size) < MIN_SIDE_PX:
        raise FrameError(
            f"images of {size[0]}×{size[1]} pixels are too small to compare; each side needs {MIN_SIDE_PX} or more"
        )


class Method(Protocol):
    """Takes processed frames as they arrive, and can be asked at any moment for what is known.

    Exposures are looked up in the table whenever an estimate is made: a lag found late applies to all frames.
    Subclasses need :meth:`push`, :attr:`progress` and :meth:`calibration`; with the rest as it is here, a method
    notices no change of the camera, and its runs can neither be merged nor continued.
    """

    def push(self, frame: Frame, prepared: PreprocessedFrame, exposures: ExposureTable) -> Change | None:
        """Take the next processed frame, and return the change of the camera that it proves, if any.

        What is held in memory stays bounded.

        Raises
        ------
        FrameError
            If the frame's image cannot be read; the method goes on as if it had not been pushed.
        """

    @property
    def progress(self) -> Progress:
        """How far it has come."""

    def calibration(self, exposures: ExposureTable, grey_range: GreyRange = FULL_RANGE) -> Calibration:
        """Return what is known now, given where black and white are; pushing may go on afterwards."""

    def compare(self, brightness: BrightnessChange, exposures: ExposureTable) -> Change | None:
        """Take the change of brightness between consecutive frames, and return the change of the camera it proves."""
        return None

    @property
    def longest_pause(self) -> int:
        """Most frames that may be skipped now."""
        return sys.maxsize

    def split(self, number: int) -> Method:
        """Return a method that goes on with what was observed from a frame on; this one keeps what was before."""
        return self

    def inputs(self, exposures: ExposureTable, grey_range: GreyRange = FULL_RANGE) -> FitInputs | None:
        """Return the evidence that calibrations of several recordings can be merged by; None where it has none."""
        return None

    def preview(self, exposures: ExposureTable) -> Preview | None:
        """Return quick estimates; None before there are any, or where it has none."""
        return None

    def state(self) -> Any:
        """Return a dataclass from which :meth:`restore` goes on; None where it has none."""
        return None

    def restore(self, state: Any) -> None:
        """Go on from a state.

        Raises
        ------
        ValueError
            If its parts do not fit each other.
        """
        raise ValueError("this method has no state to go on from")

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Numbers of the frames that are to be given to :meth:`replay` after a state was restored."""
        return frozenset()

    def replay(self, prepared: PreprocessedFrame) -> None:
        """Take a frame again that had been pushed before the state was saved."""
        return
