"""Linear least squares that outliers cannot spoil: iteratively reweighted."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ospc.arrays import FloatArray

WeightFunction: TypeAlias = Callable[[FloatArray], FloatArray]
"""Takes residuals, shape (n,), returns weights, shape (n,)."""


def robust_scale(residuals: FloatArray) -> float:
    """Return the standard deviation a normal distribution of the same median absolute value would have."""
    return float(np.median(np.abs(residuals)) * 1.4826) if residuals.size else 0.0


def uniform_weights(residuals: FloatArray) -> FloatArray:
    """Return the weights of plain least squares (L2)."""
    return np.ones_like(residuals)


def absolute_weights(residuals: FloatArray) -> FloatArray:
    """Return the weights that make the sum of squares a sum of absolute values (L1)."""
    floor = max(1e-6 * robust_scale(residuals), np.finfo(float).tiny)
    return np.asarray(1.0 / np.maximum(np.abs(residuals), floor))


def huber_weights(residuals: FloatArray, tuning: float = 1.345) -> FloatArray:
    """Return the weights of Huber's M-estimator, its scale estimated from the residuals (Huber 1964)."""
    threshold = tuning * max(robust_scale(residuals), np.finfo(float).tiny)
    return np.asarray(np.minimum(1.0, threshold / np.maximum(np.abs(residuals), np.finfo(float).tiny)))


def reweighted_least_squares(
    matrix: FloatArray, target: FloatArray, weights: WeightFunction, iterations: int = 100, tolerance: float = 1e-9
) -> FloatArray:
    """Solve ``matrix @ x ≈ target`` by iteratively reweighted least squares, from the plain solution on.

    Parameters
    ----------
    matrix
        Shape (n, p).
    target
        Shape (n,).
    weights
        Weight of each equation from its residual.
    iterations
        Most rounds.
    tolerance
        Largest change of the solution, relative to its norm, at which it counts as found.

    Returns
    -------
    FloatArray
        Shape (p,).
    """
    solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
    for _ in range(iterations):
        root = np.sqrt(weights(matrix @ solution - target))
        previous, solution = solution, np.linalg.lstsq(matrix * root[:, None], target * root, rcond=None)[0]
        if np.linalg.norm(solution - previous) <= tolerance * max(float(np.linalg.norm(solution)), 1e-12):
            break
    return np.asarray(solution)
