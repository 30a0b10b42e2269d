"""Exposures by frame number."""

from __future__ import annotations

from math import log
from typing import Protocol

import numpy as np

from ospc.arrays import FloatArray, IntArray


class ExposureLookup(Protocol):
    """Tells the exposure of any frame pushed so far.

    Methods keep frame numbers and look exposures up when they make an estimate. What is found out late, such as
    exposures that lag behind their frames, so applies to earlier frames too.
    """

    def log_exposure_of(self, frame_numbers: IntArray) -> FloatArray:
        """Return the exposures of frames.

        Parameters
        ----------
        frame_numbers
            Values of :attr:`Frame.index <ospc.recording.frame.Frame.index>`, shape (n,).

        Returns
        -------
        FloatArray
            Natural logarithm of the exposure (time × linear gain) in milliseconds, shape (n,).
        """
        ...


class StatedExposures:
    """The exposures that a recording states, as they are.

    Each frame takes a few dozen bytes, so that hours of video fit into memory.
    """

    def __init__(self) -> None:
        self._log_exposure: dict[int, float] = {}

    def add(self, frame_number: int, exposure_ms: float) -> None:
        """Remember the exposure of a frame, positive, in milliseconds."""
        self._log_exposure[frame_number] = log(exposure_ms)

    def log_exposure_of(self, frame_numbers: IntArray) -> FloatArray:
        """Return ln of the exposures in milliseconds, shape (n,)."""
        return np.array([self._log_exposure[number] for number in frame_numbers.tolist()], dtype=np.float64)
