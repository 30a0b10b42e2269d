"""A latent gain of each frame: its brightness relative to that predicted by response, vignette and exposure.

Clouds, flicker, a drifting white balance or an inexact exposure change all points of a frame equally. The gains are
modelled as a Gaussian process of unknown scale. Some of its components are independent from frame to frame, others
change slowly, and one is the same in all frames of one exposure, which may be stated inexactly. They are
marginalised. The differences between the points of a pair of frames keep their full weight; the mean of a pair has
less weight the larger the gains are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.numerics.robust import ERROR_OF_SCALE, robust_scale, tail_scale
from ospc.observations import ExposedObservations
from ospc.settings.residuals import (
    EXCEPTIONAL_ITERATIONS,
    EXCEPTIONAL_SIGMAS,
    GAIN_KINDS,
    GAIN_MEMORIES,
    GAIN_SIGMAS,
    MIN_TAIL_SCALE,
    PAIRS_PER_GAIN_BLOCK,
    VARIANCE_ITERATIONS,
)


@dataclass(frozen=True)
class PairEnds:
    """The two frames of each pair."""

    frames: IntArray
    """Their numbers, shape (pairs, 2)."""
    log_exposure: FloatArray
    """ln of their stated exposures, shape (pairs, 2)."""

    @classmethod
    def of(cls, observations: ExposedObservations) -> PairEnds:
        """Return the frames of observations in pairs."""
        ends = observations.ends_of_groups
        return cls(observations.frame[ends], observations.log_exposure[ends])

    def __getitem__(self, part: slice) -> PairEnds:
        """Return some of the pairs."""
        return PairEnds(self.frames[part], self.log_exposure[part])

    def correlations(self, end: int) -> FloatArray:
        """Return the correlations of both ends with one end of each pair, by kind, shape (kinds, 2, pairs, pairs)."""
        apart = np.abs(self.frames.T[:, :, None] - self.frames[:, end])
        return _correlations(apart, self.log_exposure.T[:, :, None] == self.log_exposure[:, end])

    @property
    def exposures_recur(self) -> bool:
        """Whether frames have the same exposures, so that errors of exposures can be told from those of frames."""
        return 2 * len(np.unique(self.log_exposure)) < len(np.unique(self.frames))


@dataclass(frozen=True)
class PairMeans:
    """Mean residuals of pairs of frames."""

    mean: FloatArray
    """The means in ln, shape (pairs,)."""
    by_chance: FloatArray
    """Their variances due to chance, shape (pairs,)."""

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.mean)

    def __getitem__(self, part: slice) -> PairMeans:
        """Return some of the pairs."""
        return PairMeans(self.mean[part], self.by_chance[part])

    def with_chance(self, factor: float) -> PairMeans:
        """Return the means with their variances due to chance multiplied by a factor."""
        return PairMeans(self.mean, factor * self.by_chance)

    @property
    def most_exceed_chance(self) -> bool:
        """Whether the scatter of most means is more than chance."""
        limit = 1 + GAIN_SIGMAS * ERROR_OF_SCALE / np.sqrt(max(len(self), 1))
        return bool(robust_scale(self._in_sigmas) >= limit)

    @property
    def some_exceed_chance(self) -> bool:
        """Whether a few means deviate by much more than chance."""
        return tail_scale(self._in_sigmas) >= MIN_TAIL_SCALE

    @property
    def initial_variances(self) -> tuple[float, ...]:
        """Variances of gains that explain the scatter of the means, in equal parts."""
        chance = float(np.median(self.by_chance))
        of_pair = max(robust_scale(self.mean), tail_scale(self.mean)) ** 2 - chance
        if of_pair <= 0:  # where some pairs have far more points; variances of zero would remain zero
            of_pair = max(robust_scale(self._in_sigmas), tail_scale(self._in_sigmas)) ** 2 * chance
        return (of_pair / (2 * GAIN_KINDS),) * GAIN_KINDS

    @property
    def _in_sigmas(self) -> FloatArray:
        return np.asarray(self.mean / np.sqrt(self.by_chance))


@dataclass(frozen=True)
class FrameGains:
    """The gains indicated by pairs of frames."""

    ends: PairEnds
    """The two frames of each pair."""
    means: PairMeans
    """Mean residual of each pair."""
    variances: tuple[float, ...]
    """Variances, in ln², of independent gains, of those of each of :data:`~ospc.settings.residuals.GAIN_MEMORIES`,
    and of those that recur with the exposure."""

    @cached_property
    def _blocks(self) -> list[_Block]:
        """Blocks of consecutive pairs with independent gains, which keeps long runs fast."""
        parts = (slice(i, i + PAIRS_PER_GAIN_BLOCK) for i in range(0, len(self.means), PAIRS_PER_GAIN_BLOCK))
        return [_Block(self.ends[part], self.means[part], np.array(self.variances)) for part in parts]

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


@dataclass(frozen=True)
class _Block:
    """Gains of a block of pairs; the variances have shape (kinds,)."""

    ends: PairEnds
    means: PairMeans
    variances: FloatArray

    @cached_property
    def _of_ends(self) -> FloatArray:
        """Covariances between gains of pairs' ends and of pairs at unit variance, shape (kinds, 2, pairs, pairs)."""
        return self.ends.correlations(0) - self.ends.correlations(1)

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
        extra = np.zeros(len(self.means))
        for _ in range(EXCEPTIONAL_ITERATIONS):
            inverse = np.linalg.inv(self._prior + np.diag(self.means.by_chance + extra))
            usual = 1 / np.diag(inverse) - extra
            apart = (inverse @ self.means.mean) / np.diag(inverse)
            extra = np.maximum(apart**2 / EXCEPTIONAL_SIGMAS**2 - usual, 0.0)
        return extra

    def covariance(self, scale: float) -> FloatArray:
        """Return the covariance of the means, shape (pairs, pairs), in units of their precision."""
        return np.asarray(scale * (self._prior + np.diag(self._exceptional)) + np.diag(self.means.by_chance))

    @property
    def of_ends(self) -> FloatArray:
        solved = np.linalg.solve(self.covariance(1.0), self.means.mean)
        of_pair = np.array([[0.5], [-0.5]]) * self._exceptional * solved
        return np.asarray(np.tensordot(self.variances, self._of_ends, axes=1) @ solved + of_pair)

    def spread(self, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the observed spread of the gains of each kind, and that expected from variances, (kinds,) each."""
        rest = np.diag(self.means.by_chance + self._exceptional)
        inverse = np.linalg.inv(np.tensordot(variances, self._of_pairs, axes=1) + rest)
        solved = inverse @ self.means.mean
        return np.sum((self._of_pairs @ solved) * solved, axis=1), np.sum(self._of_pairs * inverse, axis=(1, 2))


def gain_sigmas(variances: tuple[float, ...], ends: PairEnds) -> tuple[float, float]:
    """Return the typical change of the gain between the frames of a pair, and the error of an exposure that recurs.

    Both are standard deviations in ln; 0 without gains.
    """
    if not variances:
        return 0.0, 0.0
    of_kinds, of_exposure = np.array(variances), 0.0
    if ends.exposures_recur:
        of_kinds[-1], of_exposure = 0.0, variances[-1]
    apart, equally_exposed = np.abs(np.diff(ends.frames)), np.diff(ends.log_exposure) == 0
    changes = 2 * np.tensordot(of_kinds, 1 - _correlations(apart, equally_exposed), axes=1)
    return float(np.sqrt(np.median(changes))), math.sqrt(of_exposure)


def _correlations(apart: IntArray, equally_exposed: BoolArray) -> FloatArray:
    """Return the correlations of gains by kind, given their distances in frames, shape (...) -> (kinds, ...)."""
    distances = np.arange(int(apart.max(initial=0)) + 1)
    over = np.sqrt(3) * distances / np.array(GAIN_MEMORIES)[:, None]
    by_distance = np.vstack([distances == 0, (1 + over) * np.exp(-over)])  # Matérn 3/2, for smooth changes
    return np.concatenate([by_distance[:, apart], equally_exposed[None]])
