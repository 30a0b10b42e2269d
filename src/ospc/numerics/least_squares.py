"""Non-negative least squares. Importing SciPy's takes a quarter of a second and a tenth of a run's memory."""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray

_ROUNDS_PER_UNKNOWN = 3
"""Maximum number of rounds per unknown, as in SciPy; half a round is typical."""


def non_negative_least_squares(matrix: FloatArray, target: FloatArray) -> FloatArray:
    """Return the x ≥ 0 that minimises |A x - b|, by the active-set method of Lawson and Hanson (1974, ch. 23).

    Parameters
    ----------
    matrix, target
        A and b, shapes (rows, n) and (rows,).

    Returns
    -------
    FloatArray
        Shape (n,).

    Raises
    ------
    ArithmeticError
        If rounding errors prevent convergence.
    """
    unknowns = matrix.shape[1]
    tolerance = 10 * max(matrix.shape) * np.finfo(np.float64).eps * np.abs(matrix).sum(axis=0).max(initial=0.0)
    found, free = np.zeros(unknowns), np.zeros(unknowns, np.bool_)
    refused = free.copy()
    for _ in range(_ROUNDS_PER_UNKNOWN * unknowns + 1):
        descent = np.where(free | refused, 0.0, matrix.T @ (target - matrix @ found))
        entering = int(np.argmax(descent))
        if descent[entering] <= tolerance:
            return found
        free[entering] = True
        solution = _solution(matrix, target, free)
        if solution[entering] <= 0:
            # In exact arithmetic it would be positive; its column depends on those that are free already.
            free[entering], refused[entering] = False, True
            continue
        refused[:] = False
        while np.any(solution[free] <= 0):
            # Step towards the solution until an unknown reaches zero, and keep that unknown at zero.
            ends = free & (solution <= 0)
            steps = found[ends] / (found[ends] - solution[ends])
            found += steps.min() * (solution - found)
            free[np.flatnonzero(ends)[steps == steps.min()]] = False
            found[~free] = 0.0
            solution = _solution(matrix, target, free)
        found = solution
    raise ArithmeticError("non-negative least squares did not converge")


def _solution(matrix: FloatArray, target: FloatArray, free: BoolArray) -> FloatArray:
    """Return the least squares solution in which only free unknowns differ from zero, shape (n,)."""
    solution = np.zeros(len(free))
    solution[free] = np.linalg.lstsq(matrix[:, free], target, rcond=None)[0]
    return solution
