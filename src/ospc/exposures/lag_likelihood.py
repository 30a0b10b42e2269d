"""How well given exposures explain observed changes of brightness.

The observed change of pair i is the weighted mean over grey bins b of ln M₁/M₀, and the model is

    d_ib = β_b x_i + a · q_ib + noise,        β_b ≥ 0,

with x_i the change of ln exposure, q_ib the mean changes of R², R⁴, x and y, of which ln of a vignette is about a
linear combination, and β_b = d ln M/d ln e, the slope of whatever response there is. The noise has a slow part (no
scene is registered perfectly) and heavy tails: it is an autoregressive process driven by Student's t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.brightness_changes import ORDER, BrightnessChanges
from ospc.robust import robust_scale

_FREEDOM = 4.0
"""Degrees of freedom of Student's t that drives the noise: its tails are heavy, and its variance is still finite."""

_ROUNDS = 10
"""Most rounds of iterated reweighting, of either kind; by then the weights hardly change."""

_SMALLEST_SCALE = 1e-4
"""Least scale of the noise, in ln of the grey level: rounding errors of images without noise must not decide."""

_POOLING = 0.05
"""Weight of the common slope in each bin, over the mean weight of the bins: bins that were hardly seen follow the
others, and those that were seen hardly notice."""

_SLOPE_ERROR = 0.1
"""Relative error of the slopes that is allowed for when outliers are weighted down: otherwise slopes that are
slightly wrong would make outliers of the largest changes of exposure, the most informative ones."""

_FACTOR_LIMITS = (0.8, 1.25)
"""Limits of the factor on the slopes that is fitted with the noise model: the bins know them to a quarter, and a
smooth noise would explain smooth exposures itself."""

_SCATTERED_FACTOR_LIMITS = (0.8, 8.0)
"""The same where single exposures are inexact: their errors make the bins give slopes that are too small."""

_SCATTERED_OUTLIER = 4.0
"""Residuals up to this times their mean are no outliers then: most changes may be errors alone, and the few real ones
must not seem to be the outliers."""

_SETTLED = 1e-6
"""Change of the slopes, and relative change of the scale, up to which they are settled: near its maximum the
likelihood then changes by far less."""

_LARGEST_MEMORY = 0.98
"""Largest sum of the magnitudes of the autoregressive coefficients: below one, so that the noise is stationary."""

_MEMORY_RIDGE = 1e-3
"""Ridge on these, over the mean diagonal of the normal matrix: recordings without noise leave them open."""

_LEAST_LOG_CHANGE = 1e-9
"""Change of ln exposure up to which it is only rounding, and no slope is fitted."""


@dataclass(frozen=True)
class LagFit:
    """Exposures fitted to n observed changes.

    ``observed`` is the change of brightness of each pair without what the vignette does, and ``explained`` what the
    exposure explains of it, shape (n,). ``log_likelihood`` is that of each pair that comes right after others,
    :attr:`BrightnessChanges.driven`, shape (m,), and ``slopes`` d ln M/d ln e in each grey bin, shape (bins,), 0
    where the exposure does not change. ``scale`` is that of what drives the noise: the part of one pair that those
    before do not predict.
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

    @property
    def unexplained_share(self) -> float:
        """Share of the energy of the observed changes that exposures do not explain; NaN where there is none."""
        energy = float(np.sum(self.observed**2))
        return float(np.sum(self.unexplained**2)) / energy if energy > 0 else float("nan")


def fit_exposures(seen: BrightnessChanges, log_change: FloatArray, nuisance: FloatArray | None = None) -> LagFit:
    """Fit changes of ln exposure, shape (n,), to observed changes of brightness.

    The size of further causes of change, ``nuisance`` of shape (n, causes), is fitted too.
    """
    changing = bool(np.any(np.abs(log_change) > _LEAST_LOG_CHANGE))
    slopes, vignette = _slopes(seen, log_change)
    mean_change, mean_moved = seen.means
    observed = mean_change - mean_moved @ vignette
    predicted = seen.share @ slopes * log_change
    causes = np.empty((len(seen), 0)) if nuisance is None else nuisance
    columns = np.column_stack([predicted, causes]) if changing else causes
    driven = seen.driven
    white, unit = seen.whitened(np.column_stack([observed, columns]))
    limits = _FACTOR_LIMITS if seen.scatter == 0 else _SCATTERED_FACTOR_LIMITS
    memory = _LARGEST_MEMORY if seen.scatter == 0 else 0.0
    size, innovation, scale = _regress(white[:, 0], white[:, 1:], driven, limits if changing else None, memory)
    # The logarithm of Student's density, but for a constant.
    log_density = -(_FREEDOM + 1) / 2 * np.log1p((innovation / scale) ** 2 / _FREEDOM) - np.log(scale)
    return LagFit(
        log_density - np.log(unit[driven]),
        slopes * (size[0] if changing else 0.0),
        observed,
        predicted * size[0] if changing else np.zeros(len(seen)),
        scale,
    )


def _slopes(seen: BrightnessChanges, log_change: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return β of each bin, and a, by iterated reweighting of whole pairs."""
    robust = np.ones(len(seen))
    mean_change, mean_moved = seen.means
    changes, moves, moved_changes, squared_moves = seen.products
    bins, terms = seen.moved.shape[1:]
    slopes, vignette = np.zeros(bins), np.zeros(terms)
    solution = np.zeros(bins + terms)
    normal = np.zeros((bins + terms, bins + terms))
    for _ in range(_ROUNDS):
        by_x = robust * log_change
        xx, xd = (by_x * log_change) @ seen.weight, by_x @ changes
        pool = _POOLING * xx.mean() + 1e-9
        normal[:bins, :bins] = np.diag(xx + pool)
        normal[:bins, bins:] = np.tensordot(by_x, moves, axes=1)
        normal[bins:, :bins] = normal[:bins, bins:].T
        normal[bins:, bins:] = np.tensordot(robust, squared_moves, axes=1) + 1e-6 * np.eye(terms)
        target = np.concatenate([xd + pool * xd.sum() / max(xx.sum(), 1e-12), robust @ moved_changes])
        before, solution = solution, np.linalg.solve(normal, target)
        slopes, vignette = np.maximum(solution[:bins], 0.0), solution[bins:]
        if np.abs(solution - before).max() < _SETTLED:
            break
        explained = seen.share @ slopes * log_change
        left = mean_change - explained - mean_moved @ vignette
        scale = max(robust_scale(left), _SMALLEST_SCALE)
        allowed = np.hypot(scale, _SLOPE_ERROR * np.abs(explained))
        if seen.scatter > 0:
            allowed = np.maximum(allowed, _SCATTERED_OUTLIER * np.abs(left).mean())
        robust = (_FREEDOM + 1) / (_FREEDOM + (left / allowed) ** 2)
    return slopes, vignette


def _regress(
    observed: FloatArray, columns: FloatArray, driven: IntArray, limits: tuple[float, float] | None, most: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return the size of each column, what drives the noise, and its scale.

    The first column's size stays within the limits, where there are any.
    """
    # What is observed and every column, at the driven pairs and at those before: shape (1 + ORDER, m, 1 + columns).
    lagged = np.column_stack([observed, columns])[driven - np.arange(1 + ORDER)[:, None]]
    memory = np.zeros(ORDER)
    size = np.zeros(columns.shape[1])
    weight = np.ones(len(driven))
    innovation = observed[driven]
    scale = max(robust_scale(innovation), _SMALLEST_SCALE)
    for _ in range(_ROUNDS):
        if columns.shape[1]:
            white = lagged[0] - np.tensordot(memory, lagged[1:], axes=1)
            target, whitened = white[:, 0], white[:, 1:]
            size = _least_squares(whitened, target, weight)
            if limits and not limits[0] <= size[0] <= limits[1]:
                size[0] = np.clip(size[0], *limits)
                size[1:] = _least_squares(whitened[:, 1:], target - whitened[:, 0] * size[0], weight)
        noise = lagged[..., 0] - lagged[..., 1:] @ size
        earlier = noise[1:].T
        memory = _least_squares(earlier, noise[0], weight, ridge=_MEMORY_RIDGE)
        memory *= min(1.0, most / max(float(np.abs(memory).sum()), 1e-12))
        innovation = noise[0] - earlier @ memory
        scale = _scale(innovation, scale)
        weight = (_FREEDOM + 1) / (_FREEDOM + (innovation / scale) ** 2)
    return size, innovation, scale


def _least_squares(columns: FloatArray, target: FloatArray, weight: FloatArray, ridge: float = 1e-9) -> FloatArray:
    if not columns.shape[1]:
        return np.zeros(0)
    weighted = columns * weight[:, None]
    normal = weighted.T @ columns
    normal[np.diag_indices_from(normal)] += ridge * np.trace(normal) / len(normal) + 1e-14
    return np.asarray(np.linalg.solve(normal, weighted.T @ target))


def _scale(values: FloatArray, scale: float) -> float:
    """Return the scale of Student's t that makes the values most likely, found from a rough one."""
    squared = values**2
    for _ in range(2 * _ROUNDS):
        before = scale
        # (ν + 1) / (ν + v²/s²) · v², the square of each value with its weight.
        weighted = squared / (_FREEDOM / (_FREEDOM + 1) + squared / ((_FREEDOM + 1) * scale**2))
        scale = max(float(np.sqrt(weighted.sum() / max(len(values), 1))), _SMALLEST_SCALE)
        if abs(scale - before) < _SETTLED * scale:
            break
    return scale
