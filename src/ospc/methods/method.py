"""What every calibration method offers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ospc.arrays import ImageSize
from ospc.errors import FrameError
from ospc.photometry.calibration import Calibration
from ospc.recording.frame import Frame

MIN_SIDE_PX = 32


@dataclass(frozen=True)
class Progress:
    """How far a method has come, in figures that are cheap to ask for after every frame.

    Attributes
    ----------
    pairs
        Pairs of frames compared so far.
    samples
        Correspondences kept so far.
    response_spread
        Standard deviation of g, its largest over the greys; None before there is an estimate.
    vignette_spread
        Standard deviation of V at the corner; None before there is an estimate.
    """

    pairs: int = 0
    samples: int = 0
    response_spread: float | None = None
    vignette_spread: float | None = None


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
    """Takes frames as they arrive, and can be asked at any moment for what is known."""

    def push(self, frame: Frame) -> None:
        """Take the next frame; what it holds in memory stays bounded.

        Raises
        ------
        FrameError
            If the frame's image cannot be read; the method goes on as if it had not been pushed.
        """
        ...

    @property
    def progress(self) -> Progress:
        """How far it has come."""
        ...

    def calibration(self) -> Calibration:
        """Return what is known now; pushing may go on afterwards."""
        ...
