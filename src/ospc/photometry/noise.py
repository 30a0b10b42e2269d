"""How noisy a grey value is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from ospc.arrays import FloatArray


@dataclass(frozen=True)
class NoiseModel:
    """Variance of a grey level in [0, 1]: read noise plus shot noise plus quantisation.

    ``var(M) = read_variance + shot_variance · M``, an affine law in the grey level itself, sums it up. Seen through a
    response with knees the noise of a sensor is not affine: ``table`` then holds what was measured.

    Attributes
    ----------
    read_variance
        Variance at black, in units of full scale squared.
    shot_variance
        Growth of the variance from black to white, in the same units.
    table
        Variances at equidistant grey levels from 0 to 1, which replace the affine law; empty where there are none.
    """

    read_variance: float
    shot_variance: float
    table: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the table."""
        object.__setattr__(self, "table", tuple(float(v) for v in self.table))

    def variance(self, grey: npt.ArrayLike) -> FloatArray:
        """Return the variance of one pixel at grey levels in [0, 1]."""
        level = np.clip(np.asarray(grey, dtype=np.float64), 0.0, 1.0)
        if self.table:
            return np.interp(level, np.linspace(0.0, 1.0, len(self.table)), self.table)
        return np.asarray(self.read_variance + self.shot_variance * level)

    def clipping_bias(self, grey: npt.ArrayLike) -> FloatArray:
        """Return by how much clipping at black and white shifts the mean of noisy pixels, shape (n,) -> (n,).

        Parameters
        ----------
        grey
            Grey level without noise, in [0, 1].
        """
        level = np.clip(np.asarray(grey, dtype=np.float64), 0.0, 1.0)
        sigma = np.sqrt(np.maximum(self.variance(level), 1e-18))
        return np.asarray(_mean_excess(-level / sigma) * sigma - _mean_excess((level - 1) / sigma) * sigma)


def _mean_excess(z: FloatArray) -> FloatArray:
    """Return E[max(x + z, 0)] of a standard normal x: what clipping adds, z standard deviations past the end."""
    return np.asarray(np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi) + z * ndtr(z))
