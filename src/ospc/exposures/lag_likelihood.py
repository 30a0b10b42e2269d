"""Likelihood of exposures given the observed brightness changes.

The observed change of pair i is the weighted mean over grey bins b of ln M₁/M₀, and the model is

    d_ib = β_b x_i + a · q_ib + n_i,        β_b ≥ 0.

x_i is the change of ln exposure. q_ib are the mean changes of R², R⁴, x and y; the change of ln V is approximately a
linear combination of them. β_b = d ln M/d ln e is the slope of the response. The noise n_i is autoregressive because
registration errors change slowly, and its innovations follow Student's t distribution because they have heavy tails.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.numerics.robust import robust_scales
from ospc.settings.brightness import AR_ORDER
from ospc.settings.lag import (
    AR_RIDGE,
    INEXACT_OUTLIER_FACTOR,
    INEXACT_SLOPE_FACTOR_LIMITS,
    MAX_AR_SUM,
    MAX_REWEIGHTINGS,
    MIN_FITTED_LOG_CHANGE,
    MIN_NOISE_SCALE_LOG,
    REGRESSION_RIDGE,
    RELATIVE_SLOPE_ERROR,
    REWEIGHTING_TOLERANCE,
    SLOPE_FACTOR_LIMITS,
    SLOPE_POOLING,
    SLOPE_RIDGE,
    STUDENT_T_DOF,
    TERM_RIDGE,
)


@dataclass(frozen=True)
class LagFit:
    """Exposures at one lag, fitted to the brightness changes of n pairs of frames."""

    log_likelihood: FloatArray
    """Log likelihood of each pair in :attr:`BrightnessSeries.predicted`, given the previous ones, shape (m,)."""
    slopes: FloatArray
    """d ln M/d ln e in each grey bin, 0 if the exposure does not change, shape (bins,)."""
    observed: FloatArray
    """Brightness change of each pair without the effect of the vignette, shape (n,)."""
    explained: FloatArray
    """The part of this change that the exposure explains, shape (n,)."""
    scale: float
    """Scale of the noise innovations, in ln of the grey level."""

    @property
    def total(self) -> float:
        """Log likelihood of all pairs."""
        return float(self.log_likelihood.sum())

    @property
    def unexplained(self) -> FloatArray:
        """Change of each pair that the exposure does not explain, shape (n,)."""
        return self.observed - self.explained

    @property
    def unexplained_share(self) -> float:
        """Share of the energy of the observed changes that exposures do not explain; NaN if there are no changes."""
        energy = float(np.sum(self.observed**2))
        return float(np.sum(self.unexplained**2)) / energy if energy > 0 else float("nan")


def fit_exposures(
    series: BrightnessSeries, log_changes: FloatArray, nuisance: FloatArray | None = None
) -> list[LagFit]:
    """Fit the changes of ln exposure at several lags to the observed brightness changes.

    All lags are fitted together: fitting small arrays one by one takes several times as long.

    Parameters
    ----------
    log_changes
        Change of ln exposure of each pair at each lag, shape (lags, n).
    nuisance
        Other causes of change with fitted amplitudes, such as flicker, shape (n, causes).

    Returns
    -------
    list of LagFit
        The fit of each lag.
    """
    lags, n = log_changes.shape
    changing = np.abs(log_changes).max(axis=1, initial=0.0) > MIN_FITTED_LOG_CHANGE
    log_changes = np.where(changing[:, None], log_changes, 0.0)
    slopes, vignette = _fit_slopes(series, log_changes)
    mean_change, mean_terms = series.means
    observed = mean_change - vignette @ mean_terms.T
    predicted = slopes @ series.bin_shares.T * log_changes
    causes = np.empty((n, 0)) if nuisance is None else nuisance
    columns = [observed[..., None], predicted[..., None], np.broadcast_to(causes, (lags, *causes.shape))]
    values = np.moveaxis(np.concatenate(columns, axis=2), 1, 0)
    white, unit = series.whitened(values.reshape(n, -1))
    white = np.moveaxis(white.reshape(values.shape), 1, 0)
    exact = series.exposure_error == 0
    size, innovation, scale = _regress_with_ar_noise(
        white[..., 0],
        white[..., 1:],
        series.predicted,
        first_limits=SLOPE_FACTOR_LIMITS if exact else INEXACT_SLOPE_FACTOR_LIMITS,
        max_ar_sum=MAX_AR_SUM if exact else 0.0,
    )
    # Logarithm of Student's t density up to a constant.
    log_density = -(STUDENT_T_DOF + 1) / 2 * np.log1p((innovation / scale) ** 2 / STUDENT_T_DOF) - np.log(scale)
    log_likelihood = log_density - np.log(unit[series.predicted])
    factor = np.where(changing, size[:, 0], 0.0)[:, None]
    parts = zip(log_likelihood, slopes * factor, observed, predicted * factor, scale[:, 0].tolist(), strict=True)
    return [LagFit(*part) for part in parts]


def _fit_slopes(series: BrightnessSeries, log_changes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return β of each bin and a for each lag by iteratively reweighted least squares."""
    # All bins of a pair share one weight.
    mean_change, mean_terms = series.means
    changes, terms, term_changes, term_products = series.products
    lags, (bins, term_count) = len(log_changes), series.vignette_terms.shape[1:]
    solution = np.zeros((lags, bins + term_count))
    normal = np.zeros((lags, bins + term_count, bins + term_count))
    settled = np.zeros(lags, np.bool_)
    robust = np.ones_like(log_changes)
    for _ in range(MAX_REWEIGHTINGS):
        by_x = robust * log_changes
        xx, xd = (by_x * log_changes) @ series.weight, by_x @ changes
        pool = SLOPE_POOLING * xx.mean(axis=1, keepdims=True) + SLOPE_RIDGE
        normal[:, range(bins), range(bins)] = xx + pool
        normal[:, :bins, bins:] = np.tensordot(by_x, terms, axes=1)
        normal[:, bins:, :bins] = np.swapaxes(normal[:, :bins, bins:], 1, 2)
        normal[:, bins:, bins:] = np.tensordot(robust, term_products, axes=1) + TERM_RIDGE * np.eye(term_count)
        common = xd.sum(axis=1, keepdims=True) / np.maximum(xx.sum(axis=1, keepdims=True), 1e-12)
        target = np.concatenate([xd + pool * common, robust @ term_changes], axis=1)
        before, found = solution, np.linalg.solve(normal, target[..., None])[..., 0]
        solution = np.where(settled[:, None], before, found)
        settled |= np.abs(solution - before).max(axis=1) < REWEIGHTING_TOLERANCE
        if settled.all():
            break
        explained = np.maximum(solution[:, :bins], 0.0) @ series.bin_shares.T * log_changes
        residual = mean_change - explained - solution[:, bins:] @ mean_terms.T
        allowed = np.hypot(_robust_scales(residual), RELATIVE_SLOPE_ERROR * np.abs(explained))
        if series.exposure_error > 0:
            allowed = np.maximum(allowed, INEXACT_OUTLIER_FACTOR * np.abs(residual).mean(axis=1, keepdims=True))
        robust = _student_t_weights(residual / allowed)
    return np.maximum(solution[:, :bins], 0.0), solution[:, bins:]


def _regress_with_ar_noise(
    observed: FloatArray,
    columns: FloatArray,
    predicted: IntArray,
    *,
    first_limits: tuple[float, float],
    max_ar_sum: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficients, shape (lags, c), the noise innovations, (lags, m), and their scale, (lags, 1)."""
    # ``observed`` has shape (lags, n) and ``columns`` (lags, n, c). ``first_limits`` bound the coefficient of the
    # first column, and ``max_ar_sum`` bounds the sum of the magnitudes of the autoregressive coefficients.
    # Observed values and columns at the predicted pairs and the pairs before them: (1 + AR_ORDER, lags, m, 1 + c).
    places = predicted - np.arange(1 + AR_ORDER)[:, None]
    lagged = np.moveaxis(np.concatenate([observed[..., None], columns], axis=2)[:, places], 1, 0)
    coefficients = np.zeros((len(observed), AR_ORDER))
    innovation = observed[:, predicted]
    weight, scale = np.ones_like(innovation), _robust_scales(innovation)
    for _ in range(MAX_REWEIGHTINGS):
        white = lagged[0] - np.einsum("lk,klmc->lmc", coefficients, lagged[1:])
        target, whitened = white[..., 0], white[..., 1:]
        size = _least_squares(whitened, target, weight)
        within = np.clip(size[:, :1], *first_limits)
        rest = _least_squares(whitened[..., 1:], target - whitened[..., 0] * within, weight)
        size = np.where(within == size[:, :1], size, np.concatenate([within, rest], axis=1))
        noise = lagged[..., 0] - np.einsum("klmc,lc->klm", lagged[..., 1:], size)
        earlier = np.moveaxis(noise[1:], 0, 2)
        coefficients = _least_squares(earlier, noise[0], weight, ridge=AR_RIDGE)
        ar_sum = np.abs(coefficients).sum(axis=1, keepdims=True)
        coefficients *= np.minimum(1.0, max_ar_sum / np.maximum(ar_sum, 1e-12))
        innovation = noise[0] - (earlier @ coefficients[..., None])[..., 0]
        scale = _student_t_scales(innovation, scale)
        weight = _student_t_weights(innovation / scale)
    return size, innovation, scale


def _least_squares(
    columns: FloatArray, target: FloatArray, weight: FloatArray, ridge: float = REGRESSION_RIDGE
) -> FloatArray:
    """Solve weighted least squares for each lag: (lags, m, c), (lags, m) and (lags, m) -> (lags, c)."""
    c = columns.shape[2]
    if not c:
        return np.zeros((len(columns), 0))
    weighted = np.swapaxes(columns * weight[..., None], 1, 2)
    normal = weighted @ columns
    diagonal = normal[:, range(c), range(c)]
    normal[:, range(c), range(c)] += ridge * diagonal.mean(axis=1, keepdims=True) + 1e-14
    return np.asarray(np.linalg.solve(normal, weighted @ target[..., None])[..., 0])


def _student_t_weights(residual: FloatArray) -> FloatArray:
    """Return the weights of residuals (divided by their scale) that turn maximum likelihood into least squares."""
    return (STUDENT_T_DOF + 1) / (STUDENT_T_DOF + residual**2)


def _student_t_scales(values: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the maximum likelihood scale of Student's t for the values of each lag, from an initial scale."""
    squared = values**2
    settled = np.zeros(scale.shape, np.bool_)
    for _ in range(2 * MAX_REWEIGHTINGS):
        before = scale
        # Weighted squares (ν + 1) / (ν + v²/s²) · v².
        weighted = squared / (STUDENT_T_DOF / (STUDENT_T_DOF + 1) + squared / ((STUDENT_T_DOF + 1) * scale**2))
        total = weighted.sum(axis=1, keepdims=True) / max(values.shape[1], 1)
        scale = np.where(settled, before, np.maximum(np.sqrt(total), MIN_NOISE_SCALE_LOG))
        settled |= np.abs(scale - before) < REWEIGHTING_TOLERANCE * scale
        if settled.all():
            break
    return scale


def _robust_scales(values: FloatArray) -> FloatArray:
    """Return the robust scale of the values of each lag, bounded below, shape (lags, n) -> (lags, 1)."""
    return np.maximum(robust_scales(values)[:, None], MIN_NOISE_SCALE_LOG)
