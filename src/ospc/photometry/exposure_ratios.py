"""Exposure ratios of pairs of frames: re-estimated from the images, and from the metadata."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.by_value import ByValue
from ospc.robust import weighted_median


@dataclass(frozen=True, eq=False)
class ExposureRatios(ByValue):
    """Exposure ratios of pairs of frames, estimated (paper, eq. mean) and from the metadata."""

    frames: IntArray
    """Indices of the two frames of each pair, shape (pairs, 2)."""
    metadata: FloatArray
    """k = e₀/e₁ from the exposures of the recording, shape (pairs,)."""
    estimated: FloatArray
    """k from grey values, response and vignette, shape (pairs,)."""
    samples: IntArray
    """Number of correspondences behind each estimate, shape (pairs,)."""
    log_sigma: FloatArray | None = None
    """Standard deviation of ln of each estimate, shape (pairs,); None where the method does not tell."""

    @classmethod
    def none(cls) -> ExposureRatios:
        """Return an empty table."""
        empty = np.empty(0)
        return cls(np.empty((0, 2), np.int64), empty, empty, np.empty(0, np.int64))

    @property
    def log_residual(self) -> FloatArray:
        """ln(estimated / metadata), shape (pairs,)."""
        return np.log(self.estimated / self.metadata)

    @property
    def misfit(self) -> float:
        """Median of the absolute log residual, each pair weighted by its samples; NaN without pairs."""
        return weighted_median(np.abs(self.log_residual), self.samples)

    @property
    def bias(self) -> float:
        """Median of the log residual signed by ln k, weighted as above; NaN without pairs.

        Positive where changes of exposure look larger than the metadata say.
        """
        return weighted_median(self.log_residual * np.sign(np.log(self.metadata)), self.samples)
