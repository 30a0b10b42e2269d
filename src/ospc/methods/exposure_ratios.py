"""Exposure ratios of pairs of frames, re-estimated from their scene points with the curves of a fit."""

from __future__ import annotations

import math

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.fit import Fit
from ospc.numerics.robust import SIGMA_OF_MEDIAN, medians
from ospc.numerics.symmetric import variances
from ospc.observations import ExposedObservations
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.geometry import cells_of
from ospc.photometry.noise import BRIGHTEST_EXPOSED, DARKEST_EXPOSED
from ospc.settings.methods import MIN_COMPARED_LOG_K
from ospc.settings.residuals import MISREGISTERED_SIGMAS, MISREGISTERED_SPREAD, RATIO_CELLS


def exposure_ratios(fit: Fit, observations: ExposedObservations) -> ExposureRatios:
    """Return the exposure ratio of every pair of frames, the median over its scene points, with its uncertainty."""
    log_irradiance = fit.log_irradiance(observations)
    exposed = (observations.grey > DARKEST_EXPOSED) & (observations.grey < BRIGHTEST_EXPOSED)
    # Compare each observation with the previous one of the same point: a pair, or neighbours in a static series.
    later = np.flatnonzero((np.diff(observations.point) == 0) & exposed[1:] & exposed[:-1]) + 1
    if not len(later):
        return ExposureRatios.none()
    observed = log_irradiance[later - 1] - log_irradiance[later]
    metadata = observations.log_exposure[later - 1] - observations.log_exposure[later]
    frames = np.stack([observations.frame[later - 1], observations.frame[later]], axis=1)
    pairs, first, pair, count = np.unique(frames, axis=0, return_index=True, return_inverse=True, return_counts=True)
    pair = pair.reshape(-1)  # NumPy 2.0 adds a dimension
    estimated = medians(observed, pair)
    deviation = observed - estimated[pair]
    spread = SIGMA_OF_MEDIAN * medians(np.abs(deviation), pair)
    by_scatter = _sigma_of_medians(spread, count, _dependence(deviation, observations.position[later], pair, count))
    by_curves = _sigma_by_curves(fit, observations, later[np.argsort(pair, kind="stable")], count)
    return ExposureRatios(pairs, np.exp(metadata[first]), np.exp(estimated), count, np.hypot(by_scatter, by_curves))


def unexplained_share(ratios: ExposureRatios) -> float:
    """Return the median of the absolute log residual over that of ln k, for changing exposures; 0 without any."""
    # Count scene points, not pairs: a pair whose registration failed has few points, which are wrong.
    log_k, residual = (np.repeat(values, ratios.samples) for values in (np.log(ratios.metadata), ratios.log_residual))
    changing = np.abs(log_k) > MIN_COMPARED_LOG_K
    if not changing.any():
        return 0.0
    return float(np.median(np.abs(residual[changing])) / np.median(np.abs(log_k[changing])))


def _dependence(deviation: FloatArray, position: FloatArray, pair: IntArray, count: IntArray) -> FloatArray:
    """Return the factor by which common errors of neighbouring points increase each median's standard deviation."""
    # The errors of misregistered or glossy surfaces are common to an image cell: the variance of a median is then
    # given by the scatter of the cells' sums of signs (cluster-robust variance; Parente and Santos Silva 2016).
    cells = math.prod(RATIO_CELLS)
    cell = pair * cells + cells_of(position, RATIO_CELLS)
    excess = np.bincount(cell, np.sign(deviation), len(count) * cells).reshape(-1, cells)
    return np.asarray(np.sqrt(np.maximum(np.sum(excess**2, axis=1) / count, 1.0)))


def _sigma_of_medians(spread: FloatArray, count: IntArray, dependence: FloatArray) -> FloatArray:
    """Return the standard deviation of the median of each group of points, from their scatter, shape (groups,)."""
    typical = float(np.median(np.repeat(spread, count)))
    wrong = spread > MISREGISTERED_SPREAD * typical
    return np.where(wrong, MISREGISTERED_SIGMAS * spread, np.sqrt(np.pi / 2 / count) * spread * dependence)


def _sigma_by_curves(fit: Fit, observations: ExposedObservations, later: IntArray, count: IntArray) -> FloatArray:
    """Return the standard deviation of each pair's ln k due to the uncertainty of the curves, shape (pairs,)."""
    # ``later`` contains the indices of the pairs' second observations in order, and ``count`` their number per pair.

    def mean_row(one: IntArray) -> FloatArray:
        rows = fit.log_irradiance_rows(observations.grey[one], observations.position[one])
        return np.asarray(rows.mean(axis=0))

    # One pair at a time: the rows of all pairs would take more memory than the rest of a fit.
    mean = np.stack([mean_row(pair - 1) - mean_row(pair) for pair in np.split(later, np.cumsum(count)[:-1])])
    n = mean.shape[1]
    return np.sqrt(variances(mean, fit.covariance[:n, :n]))
