"""How noisy a grey value is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray


@dataclass(frozen=True)
class NoiseModel:
    """Variance of a grey level in [0, 1]: read noise plus shot noise plus quantisation.

    ``var(M) = read_variance + shot_variance · M``, an affine law in the grey level itself: the law in irradiance
    seen through the response is smooth enough for it to hold within the factor that weighting needs.

    Attributes
    ----------
    read_variance
        Variance at black, in units of full scale squared.
    shot_variance
        Growth of the variance from black to white, in the same units.
    """

    read_variance: float
    shot_variance: float

    def variance(self, grey: npt.ArrayLike) -> FloatArray:
        """Return the variance of one pixel at grey levels in [0, 1]."""
        level = np.clip(np.asarray(grey, dtype=np.float64), 0.0, 1.0)
        return np.asarray(self.read_variance + self.shot_variance * level)
