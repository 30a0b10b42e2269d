"""An estimate of the lag of the exposures, with what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.by_value import ByValue
from ospc.exposures.flicker import Flicker
from ospc.exposures.lag_likelihood import LagFit

LagState = Literal[
    "determined",
    "constant exposure",
    "too few pairs",
    "changes too small",
    "no response to exposure",
    "ambiguous",
    "follows flicker",
    "between frames",
    "changing",
    "out of range",
]

SILENT: tuple[LagState, ...] = ("no response to exposure", "changes too small")
"""States in which exposures do not show in the images at all."""


@dataclass(frozen=True, eq=False)
class LagEstimate(ByValue):
    """By how many frames the exposures come late.

    Attributes
    ----------
    state
        ``"determined"``, or why the lag is not.
    frames
        The lag L: the exposure written beside frame i is the one that frame i − L was taken with. None where it is
        not determined.
    candidates
        Lags that fit too well to be excluded, best first.
    lags
        Lags tried, shape (m,).
    score
        Log likelihood of each, relative to the best, shape (m,).
    sigmas
        By how many standard deviations the best fits better than each; 0 for itself, shape (m,).
    fraction_frames
        Where between the best lag and its neighbours the fit is best, in frames.
    pairs
        Number of pairs of consecutive frames behind it.
    fit
        The fit at the best lag, or without exposures where they do not change; None without pairs.
    frame
        Index of the first frame of each pair of the fit, shape (pairs,).
    flicker
        Periodic changes of brightness that the exposures do not explain, strongest first.
    """

    state: LagState
    frames: int | None
    candidates: tuple[int, ...]
    lags: IntArray
    score: FloatArray
    sigmas: FloatArray
    fraction_frames: float = 0.0
    pairs: int = 0
    fit: LagFit | None = field(default=None, repr=False)
    frame: IntArray = field(default_factory=lambda: np.empty(0, np.int64), repr=False)
    flicker: tuple[Flicker, ...] = ()

    def correction(self, cycle_frames: int | None) -> int | None:
        """Return the lag to correct exposures by; None where that is not certain.

        If exposures repeat, all lags that differ by whole cycles correct them alike, and any of them will do.

        Parameters
        ----------
        cycle_frames
            After how many frames the exposures repeat; None if they do not.
        """
        if self.frames is not None or self.state != "ambiguous" or cycle_frames is None:
            return self.frames
        smallest = min(self.candidates, key=abs)
        return None if any((lag - smallest) % cycle_frames for lag in self.candidates) else smallest

    @property
    def silent(self) -> bool:
        """Whether the exposures change but do not show in the images."""
        return self.state in SILENT
