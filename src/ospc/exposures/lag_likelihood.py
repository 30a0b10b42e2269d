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
from ospc.exposures.brightness_changes import BrightnessChanges
from ospc.robust import SIGMA_OF_MEDIAN
from ospc.settings.exposures import (
    AR_ORDER,
    AR_RIDGE,
    INEXACT_OUTLIER_FACTOR,
    INEXACT_SLOPE_FACTOR_LIMITS,
    MAX_AR_SUM,
    MAX_REWEIGHTINGS,
    MIN_FITTED_LOG_CHANGE,
    MIN_NOISE_SCALE_LOG,
    RELATIVE_SLOPE_ERROR,
    REWEIGHTING_TOLERANCE,
    SLOPE_FACTOR_LIMITS,
    SLOPE_POOLING,
    STUDENT_T_DOF,
)


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


def fit_exposures(
    seen: BrightnessChanges, log_changes: FloatArray, nuisance: FloatArray | None = None
) -> list[LagFit]:
    """Fit several changes of ln exposure, those of different lags, to observed changes of brightness.

    The changes have shape (lags, n), and there is a fit for each lag. The size of further causes of change,
    ``nuisance`` of shape (n, causes), is fitted too. All lags are fitted at once: one by one, small arrays take
    several times as long.
    """
    lags, n = log_changes.shape
    changing = np.abs(log_changes).max(axis=1, initial=0.0) > MIN_FITTED_LOG_CHANGE
    log_changes = np.where(changing[:, None], log_changes, 0.0)
    slopes, vignette = _slopes(seen, log_changes)
    mean_change, mean_moved = seen.means
    observed = mean_change - vignette @ mean_moved.T
    predicted = slopes @ seen.share.T * log_changes
    causes = np.empty((n, 0)) if nuisance is None else nuisance
    columns = [observed[..., None], predicted[..., None], np.broadcast_to(causes, (lags, *causes.shape))]
    values = np.moveaxis(np.concatenate(columns, axis=2), 1, 0)
    white, unit = seen.whitened(values.reshape(n, -1))
    white = np.moveaxis(white.reshape(values.shape), 1, 0)
    limits = SLOPE_FACTOR_LIMITS if seen.scatter == 0 else INEXACT_SLOPE_FACTOR_LIMITS
    memory = MAX_AR_SUM if seen.scatter == 0 else 0.0
    driven = seen.driven
    size, innovation, scale = _regress(white[..., 0], white[..., 1:], driven, limits, memory)
    # The logarithm of Student's density, but for a constant.
    log_density = -(STUDENT_T_DOF + 1) / 2 * np.log1p((innovation / scale) ** 2 / STUDENT_T_DOF) - np.log(scale)
    log_likelihood = log_density - np.log(unit[driven])
    factor = np.where(changing, size[:, 0], 0.0)[:, None]
    parts = zip(log_likelihood, slopes * factor, observed, predicted * factor, scale[:, 0].tolist(), strict=True)
    return [LagFit(*part) for part in parts]


def _slopes(seen: BrightnessChanges, log_changes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return β of each bin, and a, of each lag by iterated reweighting of whole pairs."""
    robust = np.ones_like(log_changes)
    mean_change, mean_moved = seen.means
    changes, moves, moved_changes, squared_moves = seen.products
    lags, (bins, terms) = len(log_changes), seen.moved.shape[1:]
    solution = np.zeros((lags, bins + terms))
    normal = np.zeros((lags, bins + terms, bins + terms))
    settled = np.zeros(lags, np.bool_)
    for _ in range(MAX_REWEIGHTINGS):
        by_x = robust * log_changes
        xx, xd = (by_x * log_changes) @ seen.weight, by_x @ changes
        pool = SLOPE_POOLING * xx.mean(axis=1, keepdims=True) + 1e-9
        normal[:, range(bins), range(bins)] = xx + pool
        normal[:, :bins, bins:] = np.tensordot(by_x, moves, axes=1)
        normal[:, bins:, :bins] = np.swapaxes(normal[:, :bins, bins:], 1, 2)
        normal[:, bins:, bins:] = np.tensordot(robust, squared_moves, axes=1) + 1e-6 * np.eye(terms)
        common = xd.sum(axis=1, keepdims=True) / np.maximum(xx.sum(axis=1, keepdims=True), 1e-12)
        target = np.concatenate([xd + pool * common, robust @ moved_changes], axis=1)
        before, found = solution, np.linalg.solve(normal, target[..., None])[..., 0]
        solution = np.where(settled[:, None], before, found)
        settled |= np.abs(solution - before).max(axis=1) < REWEIGHTING_TOLERANCE
        if settled.all():
            break
        explained = np.maximum(solution[:, :bins], 0.0) @ seen.share.T * log_changes
        left = mean_change - explained - solution[:, bins:] @ mean_moved.T
        allowed = np.hypot(_robust_scales(left), RELATIVE_SLOPE_ERROR * np.abs(explained))
        if seen.scatter > 0:
            allowed = np.maximum(allowed, INEXACT_OUTLIER_FACTOR * np.abs(left).mean(axis=1, keepdims=True))
        robust = (STUDENT_T_DOF + 1) / (STUDENT_T_DOF + (left / allowed) ** 2)
    return np.maximum(solution[:, :bins], 0.0), solution[:, bins:]


def _regress(
    observed: FloatArray, columns: FloatArray, driven: IntArray, limits: tuple[float, float], most: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the size of each column, (lags, c), what drives the noise, (lags, m), and its scale, (lags, 1).

    What is observed has shape (lags, n), and the columns (lags, n, c). The first column's size stays within the
    limits.
    """
    # What is observed and every column, at the driven pairs and those before: shape (1 + AR_ORDER, lags, m, 1 + c).
    places = driven - np.arange(1 + AR_ORDER)[:, None]
    lagged = np.moveaxis(np.concatenate([observed[..., None], columns], axis=2)[:, places], 1, 0)
    memory = np.zeros((len(observed), AR_ORDER))
    innovation = observed[:, driven]
    weight, scale = np.ones_like(innovation), _robust_scales(innovation)
    for _ in range(MAX_REWEIGHTINGS):
        white = lagged[0] - np.einsum("lk,klmc->lmc", memory, lagged[1:])
        target, whitened = white[..., 0], white[..., 1:]
        size = _least_squares(whitened, target, weight)
        within = np.clip(size[:, :1], *limits)
        rest = _least_squares(whitened[..., 1:], target - whitened[..., 0] * within, weight)
        size = np.where(within == size[:, :1], size, np.concatenate([within, rest], axis=1))
        noise = lagged[..., 0] - np.einsum("klmc,lc->klm", lagged[..., 1:], size)
        earlier = np.moveaxis(noise[1:], 0, 2)
        memory = _least_squares(earlier, noise[0], weight, ridge=AR_RIDGE)
        memory *= np.minimum(1.0, most / np.maximum(np.abs(memory).sum(axis=1, keepdims=True), 1e-12))
        innovation = noise[0] - (earlier @ memory[..., None])[..., 0]
        scale = _scales(innovation, scale)
        weight = (STUDENT_T_DOF + 1) / (STUDENT_T_DOF + (innovation / scale) ** 2)
    return size, innovation, scale


def _least_squares(columns: FloatArray, target: FloatArray, weight: FloatArray, ridge: float = 1e-9) -> FloatArray:
    """Return the weighted least squares solution of each lag, (lags, m, c), (lags, m) and (lags, m) -> (lags, c)."""
    c = columns.shape[2]
    if not c:
        return np.zeros((len(columns), 0))
    weighted = np.swapaxes(columns * weight[..., None], 1, 2)
    normal = weighted @ columns
    diagonal = normal[:, range(c), range(c)]
    normal[:, range(c), range(c)] += ridge * diagonal.mean(axis=1, keepdims=True) + 1e-14
    return np.asarray(np.linalg.solve(normal, weighted @ target[..., None])[..., 0])


def _scales(values: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the scale of Student's t that makes the values of each lag most likely, found from a rough one."""
    squared = values**2
    settled = np.zeros(scale.shape, np.bool_)
    for _ in range(2 * MAX_REWEIGHTINGS):
        before = scale
        # (ν + 1) / (ν + v²/s²) · v², the square of each value with its weight.
        weighted = squared / (STUDENT_T_DOF / (STUDENT_T_DOF + 1) + squared / ((STUDENT_T_DOF + 1) * scale**2))
        total = weighted.sum(axis=1, keepdims=True) / max(values.shape[1], 1)
        scale = np.where(settled, before, np.maximum(np.sqrt(total), MIN_NOISE_SCALE_LOG))
        settled |= np.abs(scale - before) < REWEIGHTING_TOLERANCE * scale
        if settled.all():
            break
    return scale


def _robust_scales(values: FloatArray) -> FloatArray:
    """Return the robust scale of the values of each lag, not too small, shape (lags, n) -> (lags, 1)."""
    if not values.size:
        return np.full((len(values), 1), MIN_NOISE_SCALE_LOG)
    found = SIGMA_OF_MEDIAN * np.median(np.abs(values), axis=1, keepdims=True)
    return np.asarray(np.maximum(found, MIN_NOISE_SCALE_LOG))
