"""Exposure ratios, re-estimated and as the metadata have them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray


@dataclass(frozen=True)
class ExposureRatios:
    """Exposure ratios of pairs of frames, estimated and according to the metadata (paper, eq. mean).

    Attributes
    ----------
    frames
        Indices of the two frames of each pair, shape (pairs, 2).
    metadata
        k = e₀/e₁ from the recording's exposures, shape (pairs,).
    estimated
        The same from grey values, response and vignette, shape (pairs,).
    samples
        Number of correspondences behind each estimate, shape (pairs,).
    """

    frames: npt.NDArray[np.int64]
    metadata: FloatArray
    estimated: FloatArray
    samples: npt.NDArray[np.int64]

    @classmethod
    def none(cls) -> ExposureRatios:
        """Return the ratios of no pairs at all."""
        empty = np.empty(0)
        return cls(np.empty((0, 2), np.int64), empty, empty, np.empty(0, np.int64))

    @property
    def log_residual(self) -> FloatArray:
        """ln(estimated / metadata), shape (pairs,)."""
        return np.log(self.estimated / self.metadata)

    @property
    def bias(self) -> float:
        """Median of the log residual signed by ln k: how much too large exposure changes look; NaN without pairs."""
        residual = self.log_residual * np.sign(np.log(self.metadata))
        return float(np.median(residual)) if residual.size else float("nan")
