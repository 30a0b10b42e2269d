"""Non-negative least squares: optimality conditions, and agreement with another implementation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from ospc.arrays import FloatArray
from ospc.numerics.least_squares import non_negative_least_squares


def problem(seed: int, rows: int, unknowns: int) -> tuple[FloatArray, FloatArray]:
    random = np.random.default_rng(seed)
    return random.normal(size=(rows, unknowns)), random.normal(size=rows)


@pytest.mark.parametrize("shape", [(1, 1), (5, 2), (33, 33), (60, 33), (8, 20)])
@pytest.mark.parametrize("seed", range(5))
def test_no_other_solution_is_better(seed: int, shape: tuple[int, int]) -> None:
    matrix, target = problem(seed, *shape)
    found = non_negative_least_squares(matrix, target)
    descent = matrix.T @ (target - matrix @ found)
    assert np.all(found >= 0)
    # The Karush-Kuhn-Tucker conditions, which are sufficient because the problem is convex.
    np.testing.assert_allclose(descent[found > 0], 0, atol=1e-10)
    assert np.all(descent[found == 0] <= 1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_it_agrees_with_scipy(seed: int) -> None:
    matrix, target = problem(seed, 50, 20)
    np.testing.assert_allclose(non_negative_least_squares(matrix, target), nnls(matrix, target)[0], atol=1e-10)


def test_it_is_the_plain_solution_where_that_is_positive() -> None:
    matrix = problem(0, 20, 6)[0]
    truth = np.arange(1.0, 7.0)
    np.testing.assert_allclose(non_negative_least_squares(matrix, matrix @ truth), truth)


def test_columns_that_depend_on_each_other_do_no_harm() -> None:
    matrix, target = problem(1, 20, 4)
    doubled = np.hstack([matrix, matrix, matrix[:, :1] * 1e-9])
    once, twice = non_negative_least_squares(matrix, target), non_negative_least_squares(doubled, target)
    assert np.all(twice >= 0)
    np.testing.assert_allclose(doubled @ twice, matrix @ once, atol=1e-8)


def test_a_target_that_nothing_reaches_gives_zero() -> None:
    assert np.array_equal(non_negative_least_squares(np.eye(3), -np.ones(3)), np.zeros(3))
