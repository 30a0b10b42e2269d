"""Exposure ratios of pairs of frames: re-estimated from the images, and from the metadata."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray


@dataclass(frozen=True)
class ExposureRatios:
    """Exposure ratios of pairs of frames, estimated (paper, eq. mean) and from the metadata.

    Attributes
    ----------
    frames
        Indices of the two frames of each pair, shape (pairs, 2).
    metadata
        k = e₀/e₁ from the exposures of the recording, shape (pairs,).
    estimated
        k from grey values, response and vignette, shape (pairs,).
    samples
        Number of correspondences behind each estimate, shape (pairs,).
    """

    frames: npt.NDArray[np.int64]
    metadata: FloatArray
    estimated: FloatArray
    samples: npt.NDArray[np.int64]

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
    def bias(self) -> float:
        """Median of log residual · sign(ln k): positive if exposure changes are overestimated; NaN without pairs."""
        residual = self.log_residual * np.sign(np.log(self.metadata))
        return float(np.median(residual)) if residual.size else float("nan")
