"""The brightness changes of a recording as arrays, to which the exposures are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.exposures.brightness import BrightnessChange
from ospc.numerics.robust import weighted_median
from ospc.settings.brightness import (
    AR_ORDER,
    GREY_BIN_EDGES,
    MAX_BIN_DEVIATION_LOG,
    MAX_BIN_DEVIATION_SHARE,
    MIN_PAIR_WEIGHT,
)


@dataclass(frozen=True)
class BrightnessSeries:
    """Brightness changes between n pairs of frames, in frame order."""

    frame: IntArray
    """Number of the first frame of each pair, shape (n,)."""
    log_ratio: FloatArray
    """As in :class:`~ospc.exposures.brightness.BrightnessChange`, one row per pair, shape (n, bins)."""
    weight: FloatArray
    """As there, shape (n, bins)."""
    vignette_terms: FloatArray
    """As there, shape (n, bins, 4)."""
    interval_frames: int = 1
    """Number of frames from the first to the second of each pair."""
    exposure_error: float = 0.0
    """Standard deviation of the brightness errors caused by errors of individual exposures, relative to the noise
    scale."""

    @classmethod
    def from_changes(cls, changes: Sequence[BrightnessChange]) -> BrightnessSeries:
        """Return the changes that are measured at enough points."""
        if not changes:
            return cls(np.empty(0, np.int64), np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0, 0)))
        series = cls(
            np.array([c.frame0 for c in changes], np.int64),
            np.stack([c.log_ratio for c in changes]),
            np.stack([_consistent_weight(c) for c in changes]),
            np.stack([c.vignette_terms for c in changes]),
        )
        return series.where(series.weight.sum(axis=1) >= MIN_PAIR_WEIGHT)

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.frame)

    def where(self, mask: BoolArray) -> BrightnessSeries:
        """Return the pairs selected by a mask, shape (n,)."""
        return replace(
            self,
            frame=self.frame[mask],
            log_ratio=self.log_ratio[mask],
            weight=self.weight[mask],
            vignette_terms=self.vignette_terms[mask],
        )

    def with_exposures(self, frames: int, *lags: int) -> BrightnessSeries:
        """Return the pairs whose frames have an exposure at each of the lags in a recording of this many frames."""
        last = self.frame + self.interval_frames
        return self.where((self.frame + min(lags) >= 0) & (last + max(lags) < frames))

    def renumbered(self, offset: int) -> BrightnessSeries:
        """Return the same pairs with an offset added to their frame numbers."""
        return replace(self, frame=self.frame + offset)

    def whitened(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Remove the correlation that errors of individual exposures cause; also return each pair's scale.

        Returns L⁻¹ values, shape (n, columns), and the diagonal of L, shape (n,). Within each run of consecutive
        pairs L Lᵀ = 1 + s² · tridiag(−1, 2, −1), where s is the :attr:`exposure_error`.
        """
        if self.exposure_error <= 0:
            return values, np.ones(len(values))
        import scipy.linalg  # slow to import and rarely needed

        # The factor of a tridiagonal matrix is bidiagonal; zeros off the diagonal separate the runs.
        joined = np.diff(self.frame, append=self.frame[-1:] + 2) == 1
        bands = np.stack([np.full(len(values), 1 + 2 * self.exposure_error**2), -(self.exposure_error**2) * joined])
        factor = scipy.linalg.cholesky_banded(bands, lower=True)
        return np.asarray(scipy.linalg.solve_banded((1, 0), factor, values)), np.asarray(factor[0])

    def over(self, interval_frames: int) -> BrightnessSeries:
        """Return changes over longer intervals: sums of the changes between consecutive frames."""
        last = interval_frames - 1
        start = np.arange(max(len(self) - last, 0))
        start = start[self.frame[start + last] - self.frame[start] == last]
        parts = start[:, None] + np.arange(interval_frames)
        weight = self.weight[parts].min(axis=1)
        # A bin counts only if it is seen in all frames of the interval.
        seen = weight > 0
        log_ratio = np.where(seen, self.log_ratio[parts].sum(axis=1), 0.0)
        terms = np.where(seen[..., None], self.vignette_terms[parts].sum(axis=1), 0.0)
        summed = BrightnessSeries(self.frame[start], log_ratio, weight, terms, interval_frames)
        return summed.where(weight.sum(axis=1) >= MIN_PAIR_WEIGHT)

    def exposure_change(self, log_exposure: FloatArray, lag: int) -> FloatArray:
        """Return the change of ln exposure of each pair if exposures lag by ``lag`` frames, shape (n,)."""
        return np.asarray(log_exposure[self.frame + self.interval_frames + lag] - log_exposure[self.frame + lag])

    @cached_property
    def bin_shares(self) -> FloatArray:
        """Weights normalised to sum to one in each pair, shape (n, bins)."""
        return np.asarray(self.weight / self.weight.sum(axis=1, keepdims=True))

    @cached_property
    def log_grey(self) -> FloatArray:
        """Mean ln grey level of the compared points of each pair, shape (n,)."""
        return np.asarray(self.bin_shares @ np.log(GREY_BIN_EDGES[1:] * GREY_BIN_EDGES[:-1])) / 2

    @cached_property
    def means(self) -> tuple[FloatArray, FloatArray]:
        """Weighted means over the bins of the change and the vignette terms, shapes (n,) and (n, 4)."""
        return np.sum(self.bin_shares * self.log_ratio, axis=1), np.einsum(
            "ib,ibk->ik", self.bin_shares, self.vignette_terms
        )

    @cached_property
    def products(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Weighted products of each pair for the normal equations, with d the change and q the vignette terms.

        w d and w q of each bin, shapes (n, bins) and (n, bins, 4), then Σ w d q and Σ w q qᵀ over the bins, shapes
        (n, 4) and (n, 4, 4).
        """
        terms = self.vignette_terms
        weighted = self.weight[:, :, None] * terms
        by_change = np.einsum("ib,ibk->ik", self.log_ratio, weighted)
        return self.weight * self.log_ratio, weighted, by_change, np.einsum("ibk,ibl->ikl", weighted, terms)

    @cached_property
    def predicted(self) -> IntArray:
        """Indices of the pairs whose noise can be predicted from the :data:`AR_ORDER` previous pairs, shape (m,)."""
        consecutive = np.diff(self.frame, prepend=self.frame[:1] - 2) == 1
        known = consecutive.copy()
        for step in range(1, AR_ORDER):
            known[step:] &= consecutive[:-step]
            known[:step] = False
        return np.flatnonzero(known)


def _consistent_weight(change: BrightnessChange) -> FloatArray:
    """Return the weights of the grey bins, zero for bins that disagree with the others, shape (bins,)."""
    # No response changes one grey level by 10 % and leaves the others unchanged. Moving objects do, and so do shaded
    # walls without texture, whose motion registration cannot measure.
    middle = weighted_median(change.log_ratio, change.weight) if change.weight.any() else 0.0
    apart = np.abs(change.log_ratio - middle)
    return np.where(apart <= MAX_BIN_DEVIATION_LOG + MAX_BIN_DEVIATION_SHARE * abs(middle), change.weight, 0.0)
