"""The changes of brightness of a recording as arrays, which lags are fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.exposures.brightness import BrightnessChange
from ospc.robust import weighted_median
from ospc.settings.exposures import AR_ORDER, MAX_BIN_DEVIATION_LOG, MAX_BIN_DEVIATION_SHARE, MIN_PAIR_WEIGHT


@dataclass(frozen=True)
class BrightnessChanges:
    """Changes of brightness between n pairs of frames, most often consecutive ones.

    ``frame`` is the index of the first frame of each pair, shape (n,), and the second comes ``step`` frames later.
    The other arrays are those of :class:`~ospc.exposures.brightness.BrightnessChange`, one row a pair. ``scatter`` is
    the standard deviation of the errors of single exposures, as changes of brightness, over the scale of the noise.
    """

    frame: IntArray
    log_ratio: FloatArray
    weight: FloatArray
    moved: FloatArray
    step: int = 1
    scatter: float = 0.0

    @classmethod
    def of(cls, changes: Sequence[BrightnessChange]) -> BrightnessChanges:
        """Collect the changes between consecutive frames that rest on enough places."""
        if not changes:
            return cls(np.empty(0, np.int64), np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0, 0)))
        all_of_them = cls(
            np.array([c.frame0 for c in changes], np.int64),
            np.stack([c.log_ratio for c in changes]),
            np.stack([_coherent(c) for c in changes]),
            np.stack([c.moved for c in changes]),
        )
        return all_of_them.where(all_of_them.weight.sum(axis=1) >= MIN_PAIR_WEIGHT)

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.frame)

    def where(self, mask: BoolArray) -> BrightnessChanges:
        """Return the pairs where a mask, shape (n,), is true."""
        return replace(
            self,
            frame=self.frame[mask],
            log_ratio=self.log_ratio[mask],
            weight=self.weight[mask],
            moved=self.moved[mask],
        )

    def within(self, frames: int, *lags: int) -> BrightnessChanges:
        """Return the pairs that have an exposure at each of these lags, of so many frames."""
        return self.where((self.frame + min(lags) >= 0) & (self.frame + self.step + max(lags) < frames))

    def whitened(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values without the correlation that errors of single exposures have, and each pair's scale.

        That is C^(−1/2) values within each run of consecutive pairs, C = 1 + scatter² · tridiag(−1, 2, −1), shape
        (n, columns), and the diagonal of the Cholesky factor of C, shape (n,).
        """
        if self.scatter <= 0:
            return values, np.ones(len(values))
        import scipy.linalg  # slow to import and rarely needed

        # The factor of a tridiagonal matrix is bidiagonal; zeros beside the diagonal separate the runs.
        joined = np.diff(self.frame, append=self.frame[-1:] + 2) == 1
        bands = np.stack([np.full(len(values), 1 + 2 * self.scatter**2), -(self.scatter**2) * joined])
        factor = scipy.linalg.cholesky_banded(bands, lower=True)
        return np.asarray(scipy.linalg.solve_banded((1, 0), factor, values)), np.asarray(factor[0])

    def summed(self, step: int) -> BrightnessChanges:
        """Return changes over several frames, as the sum of those from each to the next."""
        start = np.arange(max(len(self) - step + 1, 0))
        start = start[self.frame[start + step - 1] - self.frame[start] == step - 1]
        parts = start[:, None] + np.arange(step)
        weight = self.weight[parts].min(axis=1)
        # A bin counts only if all the frames show it.
        seen = weight > 0
        log_ratio = np.where(seen, self.log_ratio[parts].sum(axis=1), 0.0)
        moved = np.where(seen[..., None], self.moved[parts].sum(axis=1), 0.0)
        summed = BrightnessChanges(self.frame[start], log_ratio, weight, moved, step)
        return summed.where(weight.sum(axis=1) >= MIN_PAIR_WEIGHT)

    def log_change(self, log_exposure: FloatArray, lag: int = 0) -> FloatArray:
        """Return the change of ln exposure of each pair if metadata are late by a lag, shape (n,)."""
        return np.asarray(log_exposure[self.frame + self.step + lag] - log_exposure[self.frame + lag])

    @cached_property
    def share(self) -> FloatArray:
        """Weights that sum to one in each pair, shape (n, bins)."""
        return np.asarray(self.weight / self.weight.sum(axis=1, keepdims=True))

    @cached_property
    def means(self) -> tuple[FloatArray, FloatArray]:
        """Weighted means of the change and of what moved over the bins of each pair, shapes (n,) and (n, 4)."""
        return np.sum(self.share * self.log_ratio, axis=1), np.einsum("ib,ibk->ik", self.share, self.moved)

    @cached_property
    def products(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Weighted products of each pair, for normal equations; d is the change and q what moved.

        They are d and q of each bin, shapes (n, bins) and (n, bins, 4), and d q and q qᵀ summed over the bins, shapes
        (n, 4) and (n, 4, 4).
        """
        weighted = self.weight[:, :, None] * self.moved
        by_change = np.einsum("ib,ibk->ik", self.log_ratio, weighted)
        return self.weight * self.log_ratio, weighted, by_change, np.einsum("ibk,ibl->ikl", weighted, self.moved)

    @cached_property
    def driven(self) -> IntArray:
        """Positions of the pairs that come right after :data:`AR_ORDER` others, shape (m,)."""
        consecutive = np.diff(self.frame, prepend=self.frame[:1] - 2) == 1
        known = consecutive.copy()
        for step in range(1, AR_ORDER):
            known[step:] &= consecutive[:-step]
            known[:step] = False
        return np.flatnonzero(known)


def _coherent(change: BrightnessChange) -> FloatArray:
    """Return the weights of the grey bins, zero for those that change quite unlike the others, shape (bins,).

    No response makes one grey level change by a tenth while the others stay. Shaded walls without texture, whose
    motion registration cannot see, and moving objects do.
    """
    middle = weighted_median(change.log_ratio, change.weight) if change.weight.any() else 0.0
    apart = np.abs(change.log_ratio - middle)
    return np.where(apart <= MAX_BIN_DEVIATION_LOG + MAX_BIN_DEVIATION_SHARE * abs(middle), change.weight, 0.0)
