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
from ospc.robust import robust_scale
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


def fit_exposures(seen: BrightnessChanges, log_change: FloatArray, nuisance: FloatArray | None = None) -> LagFit:
    """Fit changes of ln exposure, shape (n,), to observed changes of brightness.

    The size of further causes of change, ``nuisance`` of shape (n, causes), is fitted too.
    """
    changing = bool(np.any(np.abs(log_change) > MIN_FITTED_LOG_CHANGE))
    slopes, vignette = _slopes(seen, log_change)
    mean_change, mean_moved = seen.means
    observed = mean_change - mean_moved @ vignette
    predicted = seen.share @ slopes * log_change
    causes = np.empty((len(seen), 0)) if nuisance is None else nuisance
    columns = np.column_stack([predicted, causes]) if changing else causes
    driven = seen.driven
    white, unit = seen.whitened(np.column_stack([observed, columns]))
    limits = SLOPE_FACTOR_LIMITS if seen.scatter == 0 else INEXACT_SLOPE_FACTOR_LIMITS
    memory = MAX_AR_SUM if seen.scatter == 0 else 0.0
    size, innovation, scale = _regress(white[:, 0], white[:, 1:], driven, limits if changing else None, memory)
    # The logarithm of Student's density, but for a constant.
    log_density = -(STUDENT_T_DOF + 1) / 2 * np.log1p((innovation / scale) ** 2 / STUDENT_T_DOF) - np.log(scale)
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
    for _ in range(MAX_REWEIGHTINGS):
        by_x = robust * log_change
        xx, xd = (by_x * log_change) @ seen.weight, by_x @ changes
        pool = SLOPE_POOLING * xx.mean() + 1e-9
        normal[:bins, :bins] = np.diag(xx + pool)
        normal[:bins, bins:] = np.tensordot(by_x, moves, axes=1)
        normal[bins:, :bins] = normal[:bins, bins:].T
        normal[bins:, bins:] = np.tensordot(robust, squared_moves, axes=1) + 1e-6 * np.eye(terms)
        target = np.concatenate([xd + pool * xd.sum() / max(xx.sum(), 1e-12), robust @ moved_changes])
        before, solution = solution, np.linalg.solve(normal, target)
        slopes, vignette = np.maximum(solution[:bins], 0.0), solution[bins:]
        if np.abs(solution - before).max() < REWEIGHTING_TOLERANCE:
            break
        explained = seen.share @ slopes * log_change
        left = mean_change - explained - mean_moved @ vignette
        scale = max(robust_scale(left), MIN_NOISE_SCALE_LOG)
        allowed = np.hypot(scale, RELATIVE_SLOPE_ERROR * np.abs(explained))
        if seen.scatter > 0:
            allowed = np.maximum(allowed, INEXACT_OUTLIER_FACTOR * np.abs(left).mean())
        robust = (STUDENT_T_DOF + 1) / (STUDENT_T_DOF + (left / allowed) ** 2)
    return slopes, vignette


def _regress(
    observed: FloatArray, columns: FloatArray, driven: IntArray, limits: tuple[float, float] | None, most: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return the size of each column, what drives the noise, and its scale.

    The first column's size stays within the limits, where there are any.
    """
    # What is observed and every column, at the driven pairs and those before: shape (1 + AR_ORDER, m, 1 + columns).
    lagged = np.column_stack([observed, columns])[driven - np.arange(1 + AR_ORDER)[:, None]]
    memory = np.zeros(AR_ORDER)
    size = np.zeros(columns.shape[1])
    weight = np.ones(len(driven))
    innovation = observed[driven]
    scale = max(robust_scale(innovation), MIN_NOISE_SCALE_LOG)
    for _ in range(MAX_REWEIGHTINGS):
        if columns.shape[1]:
            white = lagged[0] - np.tensordot(memory, lagged[1:], axes=1)
            target, whitened = white[:, 0], white[:, 1:]
            size = _least_squares(whitened, target, weight)
            if limits and not limits[0] <= size[0] <= limits[1]:
                size[0] = np.clip(size[0], *limits)
                size[1:] = _least_squares(whitened[:, 1:], target - whitened[:, 0] * size[0], weight)
        noise = lagged[..., 0] - lagged[..., 1:] @ size
        earlier = noise[1:].T
        memory = _least_squares(earlier, noise[0], weight, ridge=AR_RIDGE)
        memory *= min(1.0, most / max(float(np.abs(memory).sum()), 1e-12))
        innovation = noise[0] - earlier @ memory
        scale = _scale(innovation, scale)
        weight = (STUDENT_T_DOF + 1) / (STUDENT_T_DOF + (innovation / scale) ** 2)
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
    for _ in range(2 * MAX_REWEIGHTINGS):
        before = scale
        # (ν + 1) / (ν + v²/s²) · v², the square of each value with its weight.
        weighted = squared / (STUDENT_T_DOF / (STUDENT_T_DOF + 1) + squared / ((STUDENT_T_DOF + 1) * scale**2))
        scale = max(float(np.sqrt(weighted.sum() / max(len(values), 1))), MIN_NOISE_SCALE_LOG)
        if abs(scale - before) < REWEIGHTING_TOLERANCE * scale:
            break
    return scale
