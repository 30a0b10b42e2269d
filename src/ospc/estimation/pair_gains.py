"""A latent gain of each pair of frames: how much brighter one frame is than response, vignette and exposures say.

Clouds, flicker, a drifting white balance or an inexact exposure change all points of a frame alike. The gains are
random, of unknown scale and with heavy tails, and they are integrated out. What the points of a pair tell of each
other still counts in full; what the pair as a whole tells counts less, the larger the gains are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray
from ospc.robust import ERROR_OF_SCALE, robust_scale
from ospc.settings.estimation import GAIN_FREEDOM, GAIN_SIGMAS


@dataclass(frozen=True)
class PairGains:
    """What the points say of the gain of each pair.

    Attributes
    ----------
    precision, mean
        One over the variance of the mean residual of each pair by chance, and this mean in ln, shape (pairs,).
    sigma
        Scale of the gains, in ln.
    """

    precision: FloatArray
    mean: FloatArray
    sigma: float = 0.0

    @cached_property
    def by_chance(self) -> FloatArray:
        """Variance of each mean by chance, shape (pairs,); huge where a pair has no point."""
        return np.asarray(1 / np.maximum(self.precision, 1e-300))

    @cached_property
    def variance(self) -> FloatArray:
        """Variance of the prior of each gain, shape (pairs,).

        It is larger for exceptional pairs: the weights are those of Student's t (Lange, Little and Taylor 1989).
        """
        usual = self.sigma**2 + self.by_chance
        exceptional = (GAIN_FREEDOM + self.mean**2 / usual) / (GAIN_FREEDOM + 1)
        return np.asarray(self.sigma**2 + usual * np.maximum(exceptional - 1, 0.0))

    @cached_property
    def values(self) -> FloatArray:
        """Most probable gains, shape (pairs,)."""
        return np.asarray(self.mean * self.variance / (self.variance + self.by_chance))

    def precision_of_means(self, scale: float) -> FloatArray:
        """Return one over the variance of each mean, gains included, shape (pairs,), in units of the precision.

        The precision at hand is too large by one over the scale, because errors of a pair have common causes.
        """
        return np.asarray(1 / (scale * self.variance + self.by_chance))

    @property
    def refitted_sigma(self) -> float:
        """The scale after one more iteration: by the scale at hand, the means should have unit scatter."""
        mean, by_chance = self._known
        return self.sigma * robust_scale(mean / np.sqrt(self.sigma**2 + by_chance))

    @property
    def significant_sigma(self) -> float:
        """The scale that the scatter of the means shows, 0 if chance explains it."""
        mean, by_chance = self._known
        scatter = robust_scale(mean / np.sqrt(by_chance))
        if scatter < 1 + GAIN_SIGMAS * ERROR_OF_SCALE / np.sqrt(max(len(mean), 1)):
            return 0.0
        return float(np.sqrt(max(robust_scale(mean) ** 2 - float(np.median(by_chance)), 0.0)))

    @property
    def _known(self) -> tuple[FloatArray, FloatArray]:
        """Mean and variance by chance of the pairs that have points."""
        known = self.precision > 0
        return self.mean[known], self.by_chance[known]
