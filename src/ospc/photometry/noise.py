"""The noise of a grey value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray

DARKEST_EXPOSED = 1.5 / 255
BRIGHTEST_EXPOSED = 253.5 / 255
"""Grey levels between which a single pixel counts as exposed. They exclude the two 8-bit values at each end, because
cameras clip to these values and lossy compression mixes them."""


@dataclass(frozen=True)
class NoiseModel:
    """Variance of a grey level in [0, 1]: read noise, shot noise and quantisation.

    Without a table, it is affine in the grey level: ``var(M) = read_variance + shot_variance · M``. A nonlinear
    response makes it nonlinear; ``table`` then has the measured variances.
    """

    read_variance: float
    """Variance at black, in units of full scale squared."""
    shot_variance: float
    """Growth of the variance from black to white, in the same units."""
    table: tuple[float, ...] = ()
    """Variances at equidistant grey levels from 0 to 1, used instead of the affine law; empty if not measured."""
    measured: tuple[float, float] = (0.0, 1.0)
    """Lowest and highest measured grey level; outside, the table repeats the nearest measurement."""
    gain_from_log_exposure: float = 0.0
    """ln of the exposure in milliseconds, times gain, from which the gain and with it the noise increases."""
    gain_power: float = 0.0
    """Growth of ln variance, at the same grey level, with ln exposure from there on; 0 without gain."""

    def __post_init__(self) -> None:
        """Freeze the table."""
        object.__setattr__(self, "table", tuple(float(v) for v in self.table))

    def variance(self, grey: npt.ArrayLike) -> FloatArray:
        """Return the variance of one pixel at grey levels in [0, 1]."""
        level = np.clip(np.asarray(grey, dtype=np.float64), 0.0, 1.0)
        if self.table:
            return np.interp(level, np.linspace(0.0, 1.0, len(self.table)), self.table)
        return np.asarray(self.read_variance + self.shot_variance * level)

    def growth(self, log_exposure: FloatArray) -> FloatArray:
        """Return the factor by which gain increases the variance at exposures, given as ln of ms, (n,) -> (n,)."""
        return np.exp(self.gain_power * np.maximum(log_exposure - self.gain_from_log_exposure, 0.0))
