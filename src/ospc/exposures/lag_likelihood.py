"""How well a course of exposures explains observed changes of brightness.

The observed change of pair i is the weighted mean over grey bins b of ln M₁/M₀, and the model is

    d_ib = β_b x_i + a · q_ib + noise,        β_b ≥ 0,

with x_i the change of ln exposure, q_ib the mean changes of R² and R⁴, of which ln of a vignette is about a linear
combination, and β_b = d ln M/d ln e, the slope of whatever response there is. The noise has a slow part (no scene is
registered perfectly) and heavy tails: it is an autoregressive process of second order driven by Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.exposures.brightness import BrightnessChange

ORDER = 2
_FREEDOM = 4.0
_ROUNDS = 10
_SMALLEST_SCALE = 1e-4
_MIN_PAIR_WEIGHT = 100.0
_POOLING = 0.05
_SLOPE_ERROR = 0.1
_UNLIKE = 0.02
_UNLIKE_SHARE = 3.0
_FACTOR_LIMITS = (0.8, 1.25)
_SCATTERED_FACTOR_LIMITS = (0.8, 8.0)
_SCATTERED_OUTLIER = 4.0
_LARGEST_MEMORY = 0.98


@dataclass(frozen=True)
class BrightnessChanges:
    """Changes of brightness between consecutive frames.

    Attributes
    ----------
    frame
        Index of the first frame of each pair, shape (n,).
    log_ratio, weight, moved
        As of :class:`~ospc.exposures.brightness.BrightnessChange`, shapes (n, bins), (n, bins) and (n, bins, terms).
    step
        How many frames later the second frame of each pair is.
    scatter
        Independent errors of single exposures, as changes of brightness, relative to what else drives the noise.
    """

    frame: IntArray
    log_ratio: FloatArray
    weight: FloatArray
    moved: FloatArray
    step: int = 1
    scatter: float = 0.0

    @classmethod
    def of(cls, changes: Sequence[BrightnessChange]) -> BrightnessChanges:
        """Collect the changes that rest on enough places."""
        nearest = [c for c in changes if c.frame1 == c.frame0 + 1]
        if not nearest:
            return cls(np.empty(0, np.int64), np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0, 0)))
        all_of_them = cls(
            np.array([c.frame0 for c in nearest], np.int64),
            np.stack([c.log_ratio for c in nearest]),
            np.stack([_coherent(c) for c in nearest]),
            np.stack([c.moved for c in nearest]),
        )
        return all_of_them.where(all_of_them.weight.sum(axis=1) >= _MIN_PAIR_WEIGHT)

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

    def whitened(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values without the correlation that errors of single exposures have, and each pair's scale.

        Parameters
        ----------
        values
            Shape (n, columns).

        Returns
        -------
        tuple of FloatArray
            C^(−1/2) values within each run of consecutive pairs, C = 1 + scatter² · tridiag(−1, 2, −1), and the
            diagonal of the Cholesky factor of C, shape (n,).
        """
        if self.scatter <= 0:
            return values, np.ones(len(values))
        # The factor of a tridiagonal matrix is bidiagonal, so runs are told apart by zeros beside its diagonal.
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
        # What is not seen all the way is not seen at all.
        seen = weight > 0
        log_ratio = np.where(seen, self.log_ratio[parts].sum(axis=1), 0.0)
        moved = np.where(seen[..., None], self.moved[parts].sum(axis=1), 0.0)
        summed = BrightnessChanges(self.frame[start], log_ratio, weight, moved, step)
        return summed.where(weight.sum(axis=1) >= _MIN_PAIR_WEIGHT)

    def log_change(self, log_exposure: FloatArray, lag: int = 0) -> FloatArray:
        """Return the change of ln exposure of each pair if metadata are late by a lag, shape (n,)."""
        return np.asarray(log_exposure[self.frame + self.step + lag] - log_exposure[self.frame + lag])

    @property
    def share(self) -> FloatArray:
        """Weights that sum to one in each pair, shape (n, bins)."""
        return np.asarray(self.weight / self.weight.sum(axis=1, keepdims=True))

    @property
    def driven(self) -> IntArray:
        """Positions of the pairs that come right after :data:`ORDER` others, shape (m,)."""
        consecutive = np.diff(self.frame, prepend=self.frame[:1] - 2) == 1
        known = consecutive.copy()
        for step in range(1, ORDER):
            known[step:] &= consecutive[:-step]
            known[:step] = False
        return np.flatnonzero(known)


def _coherent(change: BrightnessChange) -> FloatArray:
    """Return the weights of the grey bins without those that change quite unlike the others, shape (bins,).

    No response makes one grey level change by a tenth while the others stay. A shaded wall without texture does, for
    the registration cannot see it move, and so does whatever moves by itself.
    """
    order = np.argsort(change.log_ratio)
    total = np.cumsum(change.weight[order])
    middle = float(change.log_ratio[order[np.searchsorted(total, total[-1] / 2)]]) if total[-1] > 0 else 0.0
    apart = np.abs(change.log_ratio - middle)
    return np.where(apart <= _UNLIKE + _UNLIKE_SHARE * abs(middle), change.weight, 0.0)


@dataclass(frozen=True)
class LagFit:
    """Exposures fitted to observed changes.

    Attributes
    ----------
    log_likelihood
        Of each pair that comes right after others, :attr:`BrightnessChanges.driven`, shape (m,).
    slopes
        d ln M/d ln e in each grey bin, shape (bins,); 0 where the exposure does not change.
    observed
        Change of brightness of each pair without what the vignette does, shape (n,).
    explained
        What the exposure explains of it, shape (n,).
    scale
        Scale of what drives the noise: what cannot be foreseen of one pair from those before.
    """

    log_likelihood: FloatArray
    slopes: FloatArray
    observed: FloatArray
    explained: FloatArray
    scale: float

    @property
    def total(self) -> float:
        """Log likelihood of all pairs."""
        return float(self.log_likelihood.sum())

    @property
    def unexplained(self) -> FloatArray:
        """What the exposure leaves of each pair's change, shape (n,)."""
        return self.observed - self.explained


def fit_exposures(seen: BrightnessChanges, log_change: FloatArray, nuisance: FloatArray | None = None) -> LagFit:
    """LagFit changes of ln exposure to observed changes of brightness.

    Parameters
    ----------
    seen
        The observed changes.
    log_change
        Change of ln exposure of each pair, shape (n,).
    nuisance
        Further causes of change, whose size is fitted too, shape (n, causes).
    """
    changing = bool(np.any(np.abs(log_change) > 1e-9))
    slopes, vignette = _slopes(seen, log_change)
    observed = np.sum(seen.share * (seen.log_ratio - seen.moved @ vignette), axis=1)
    foreseen = np.sum(seen.share * slopes, axis=1) * log_change
    causes = np.empty((len(seen), 0)) if nuisance is None else nuisance
    columns = np.column_stack([foreseen, causes]) if changing else causes
    driven = seen.driven
    white, unit = seen.whitened(np.column_stack([observed, columns]))
    limits = _FACTOR_LIMITS if seen.scatter == 0 else _SCATTERED_FACTOR_LIMITS
    memory = _LARGEST_MEMORY if seen.scatter == 0 else 0.0
    size, innovation, scale = _regress(white[:, 0], white[:, 1:], driven, limits if changing else None, memory)
    return LagFit(
        _log_density(innovation, scale) - np.log(unit[driven]),
        slopes * (size[0] if changing else 0.0),
        observed,
        foreseen * size[0] if changing else np.zeros(len(seen)),
        scale,
    )


def _slopes(seen: BrightnessChanges, log_change: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return β of each bin, and a, by iterated reweighting of whole pairs."""
    robust = np.ones(len(seen))
    x = log_change[:, None]
    bins, terms = seen.moved.shape[1:]
    slopes, vignette = np.zeros(bins), np.zeros(terms)
    normal = np.zeros((bins + terms, bins + terms))
    for _ in range(_ROUNDS):
        weight = seen.weight * robust[:, None]
        xx = (weight * x**2).sum(axis=0)
        xd = (weight * x * seen.log_ratio).sum(axis=0)
        # Bins that were hardly seen lean on the others.
        pool = _POOLING * xx.mean() + 1e-9
        normal[:bins, :bins] = np.diag(xx + pool)
        normal[:bins, bins:] = np.einsum("nb,nbk->bk", weight * x, seen.moved)
        normal[bins:, :bins] = normal[:bins, bins:].T
        normal[bins:, bins:] = np.einsum("nb,nbk,nbl->kl", weight, seen.moved, seen.moved) + 1e-6 * np.eye(terms)
        target = np.concatenate(
            [
                xd + pool * xd.sum() / max(xx.sum(), 1e-12),
                np.einsum("nb,nbk->k", weight * seen.log_ratio, seen.moved),
            ]
        )
        solution = np.linalg.solve(normal, target)
        slopes, vignette = np.maximum(solution[:bins], 0.0), solution[bins:]
        left = np.sum(seen.share * (seen.log_ratio - slopes * x - seen.moved @ vignette), axis=1)
        scale = max(1.4826 * float(np.median(np.abs(left))), _SMALLEST_SCALE)
        # Where the exposure changes much, a slope that is a little wrong is no outlier.
        allowed = np.hypot(scale, _SLOPE_ERROR * np.abs(np.sum(seen.share * slopes, axis=1) * log_change))
        if seen.scatter > 0:
            # Most changes may be errors alone, and the few real ones must not seem to be the outliers.
            allowed = np.maximum(allowed, _SCATTERED_OUTLIER * np.abs(left).mean())
        robust = (_FREEDOM + 1) / (_FREEDOM + (left / allowed) ** 2)
    return slopes, vignette


def _regress(
    observed: FloatArray, columns: FloatArray, driven: IntArray, limits: tuple[float, float] | None, most: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return the size of each column, what drives the noise, and its scale.

    The first column's size, where limits are given, stays near the one that the bins gave: a smooth noise model would
    gladly explain smooth exposures itself. Errors of single exposures make the bins give too small a one.
    """
    memory = np.zeros(ORDER)
    size = np.zeros(columns.shape[1])
    weight = np.ones(len(driven))
    innovation, scale = observed[driven], _SMALLEST_SCALE
    for _ in range(_ROUNDS):
        if columns.shape[1]:
            whitened = _unforeseen(columns, driven, memory)
            size = _least_squares(whitened, _unforeseen(observed, driven, memory), weight)
            if limits and not limits[0] <= size[0] <= limits[1]:
                size[0] = np.clip(size[0], *limits)
                rest = _unforeseen(observed - columns[:, 0] * size[0], driven, memory)
                size[1:] = _least_squares(whitened[:, 1:], rest, weight)
        noise = observed - columns @ size
        earlier = np.column_stack([noise[driven - step] for step in range(1, ORDER + 1)])
        memory = _least_squares(earlier, noise[driven], weight, ridge=1e-3)
        memory *= min(1.0, most / max(float(np.abs(memory).sum()), 1e-12))
        innovation = noise[driven] - earlier @ memory
        scale = _scale(innovation)
        weight = (_FREEDOM + 1) / (_FREEDOM + (innovation / scale) ** 2)
    return size, innovation, scale


def _unforeseen(values: FloatArray, driven: IntArray, memory: FloatArray) -> FloatArray:
    """Return what is left of the driven values after foreseeing them from those before."""
    return np.asarray(values[driven] - sum(memory[k] * values[driven - 1 - k] for k in range(ORDER)))


def _least_squares(columns: FloatArray, target: FloatArray, weight: FloatArray, ridge: float = 1e-9) -> FloatArray:
    if not columns.shape[1]:
        return np.zeros(0)
    weighted = columns * weight[:, None]
    normal = weighted.T @ columns
    normal[np.diag_indices_from(normal)] += ridge * np.trace(normal) / len(normal) + 1e-14
    return np.asarray(np.linalg.solve(normal, weighted.T @ target))


def _scale(values: FloatArray) -> float:
    """Return the scale of Student's t that makes the values most likely."""
    scale = max(1.4826 * float(np.median(np.abs(values))), _SMALLEST_SCALE) if len(values) else _SMALLEST_SCALE
    for _ in range(2 * _ROUNDS):
        weight = (_FREEDOM + 1) / (_FREEDOM + (values / scale) ** 2)
        scale = max(float(np.sqrt(np.mean(weight * values**2))) if len(values) else 0.0, _SMALLEST_SCALE)
    return scale


def _log_density(values: FloatArray, scale: float) -> FloatArray:
    """Return the logarithm of Student's density, but for a constant."""
    return np.asarray(-(_FREEDOM + 1) / 2 * np.log1p((values / scale) ** 2 / _FREEDOM) - np.log(scale))
