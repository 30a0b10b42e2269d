"""A latent gain of each frame: its brightness relative to that predicted by response, vignette and exposure.

Clouds, flicker, a drifting white balance or an inexact exposure change all points of a frame equally. The gains are
modelled as a Gaussian process in time of unknown scale: some components are independent from frame to frame, others
change slowly. They are marginalised. The differences between the points of a pair of frames keep their full weight;
the mean of a pair has less weight the larger the gains are and the further apart its frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.robust import ERROR_OF_SCALE, robust_scale
from ospc.settings.residuals import (
    EXCEPTIONAL_ITERATIONS,
    EXCEPTIONAL_SIGMAS,
    GAIN_MEMORIES,
    GAIN_SIGMAS,
    PAIRS_PER_GAIN_BLOCK,
    VARIANCE_ITERATIONS,
)


@dataclass(frozen=True)
class FrameGains:
    """The gains indicated by pairs of frames.

    Attributes
    ----------
    frames
        Numbers of the two frames of each pair, shape (pairs, 2).
    by_chance, mean
        Variance by chance of the mean residual of each pair, and this mean in ln, shape (pairs,).
    variances
        Variances, in ln², of independent gains and of those of each of
        :data:`~ospc.settings.residuals.GAIN_MEMORIES`; empty for no gains.
    """

    frames: IntArray
    by_chance: FloatArray
    mean: FloatArray
    variances: tuple[float, ...] = ()

    @cached_property
    def _blocks(self) -> list[_Block]:
        """Blocks of consecutive pairs with independent gains, which keeps long runs fast."""
        parts = (slice(i, i + PAIRS_PER_GAIN_BLOCK) for i in range(0, len(self.mean), PAIRS_PER_GAIN_BLOCK))
        variances = np.array(self.variances)
        return [_Block(self.frames[part], self.by_chance[part], self.mean[part], variances) for part in parts]

    def whitened(self, values: FloatArray, scale: float) -> FloatArray:
        """Return values of pairs, shape (pairs, k), times the inverse root of the covariance of the means.

        The covariance is in units of the precision, which is too large by one over ``scale`` because errors within a
        pair share causes.
        """
        roots = [np.linalg.cholesky(block.covariance(scale)) for block in self._blocks]
        parts = np.split(values, np.cumsum([len(root) for root in roots])[:-1])
        return np.concatenate([np.linalg.solve(root, part) for root, part in zip(roots, parts, strict=True)])

    @property
    def of_ends(self) -> FloatArray:
        """Most probable gains of the two frames of each pair, shape (2, pairs).

        The excess of an exceptional pair is divided equally between its frames.
        """
        return np.concatenate([block.of_ends for block in self._blocks], axis=1)

    @property
    def refitted_variances(self) -> tuple[float, ...]:
        """The variances after further steps towards the maximum likelihood (Zhou and others 2019)."""
        variances = np.array(self.variances)
        for _ in range(VARIANCE_ITERATIONS):
            seen, expected = np.sum([block.spread(variances) for block in self._blocks], axis=0)
            variances = variances * np.sqrt(seen / expected)
        return tuple(variances.tolist())

    @property
    def significant_variances(self) -> tuple[float, ...]:
        """Initial variances from the scatter of the means, empty if chance explains it."""
        scatter = robust_scale(self.mean / np.sqrt(self.by_chance))
        if scatter < 1 + GAIN_SIGMAS * ERROR_OF_SCALE / np.sqrt(max(len(self.mean), 1)):
            return ()
        chance = float(np.median(self.by_chance))
        of_pair = robust_scale(self.mean) ** 2 - chance
        if of_pair <= 0:  # where some pairs have far more points; variances of zero would remain zero
            of_pair = (scatter**2 - 1) * chance
        kinds = 1 + len(GAIN_MEMORIES)
        return (of_pair / (2 * kinds),) * kinds


@dataclass(frozen=True)
class _Block:
    """Gains of a block of pairs; the variances have shape (kinds,)."""

    frames: IntArray
    by_chance: FloatArray
    mean: FloatArray
    variances: FloatArray

    @cached_property
    def _of_ends(self) -> FloatArray:
        """Covariances between gains of pairs' ends and of pairs at unit variance, shape (kinds, 2, pairs, pairs)."""
        first, second = (np.abs(self.frames.T[:, :, None] - end) for end in self.frames.T)
        correlations = _correlations(int(max(first.max(), second.max())))
        return correlations[:, first] - correlations[:, second]

    @cached_property
    def _of_pairs(self) -> FloatArray:
        """Covariances of the gains of pairs at unit variance, shape (kinds, pairs, pairs)."""
        return np.asarray(self._of_ends[:, 0] - self._of_ends[:, 1])

    @cached_property
    def _prior(self) -> FloatArray:
        return np.tensordot(self.variances, self._of_pairs, axes=1)

    @cached_property
    def _exceptional(self) -> FloatArray:
        """Additional variance of exceptional pairs, shape (pairs,), which limits their distance from the others."""
        extra = np.zeros(len(self.mean))
        for _ in range(EXCEPTIONAL_ITERATIONS):
            inverse = np.linalg.inv(self._prior + np.diag(self.by_chance + extra))
            usual = 1 / np.diag(inverse) - extra
            apart = (inverse @ self.mean) / np.diag(inverse)
            extra = np.maximum(apart**2 / EXCEPTIONAL_SIGMAS**2 - usual, 0.0)
        return extra

    def covariance(self, scale: float) -> FloatArray:
        """Return the covariance of the means, shape (pairs, pairs), in units of their precision."""
        return np.asarray(scale * (self._prior + np.diag(self._exceptional)) + np.diag(self.by_chance))

    @property
    def of_ends(self) -> FloatArray:
        solved = np.linalg.solve(self.covariance(1.0), self.mean)
        of_pair = np.array([[0.5], [-0.5]]) * self._exceptional * solved
        return np.asarray(np.tensordot(self.variances, self._of_ends, axes=1) @ solved + of_pair)

    def spread(self, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the observed spread of the gains of each kind, and that expected from variances, (kinds,) each."""
        rest = np.diag(self.by_chance + self._exceptional)
        inverse = np.linalg.inv(np.tensordot(variances, self._of_pairs, axes=1) + rest)
        solved = inverse @ self.mean
        return np.sum((self._of_pairs @ solved) * solved, axis=1), np.sum(self._of_pairs * inverse, axis=(1, 2))


def gain_sigma(variances: tuple[float, ...], frames: IntArray) -> float:
    """Return the typical standard deviation of the gain of pairs of frames, (pairs, 2), in ln; 0 without gains."""
    if not variances:
        return 0.0
    apart = np.abs(np.diff(frames, axis=1))
    change = 2 * np.tensordot(variances, 1 - _correlations(int(apart.max(initial=0)))[:, apart], axes=1)
    return float(np.sqrt(np.median(change)))


def _correlations(longest: int) -> FloatArray:
    """Return the correlation of gains at distances of 0, 1 … frames, by kind, shape (kinds, longest + 1)."""
    apart = np.arange(longest + 1)
    over = np.sqrt(3) * apart / np.array(GAIN_MEMORIES)[:, None]
    return np.vstack([apart == 0, (1 + over) * np.exp(-over)])  # Matérn 3/2, for smooth changes
