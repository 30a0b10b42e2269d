"""Eigenvalues of symmetric matrices."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.numerics.symmetric import eigh


@pytest.fixture
def divide_and_conquer_fails(monkeypatch):
    def fails(_matrix):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(np.linalg, "eigh", fails)


def test_another_algorithm_steps_in_where_that_of_numpy_does_not_converge(divide_and_conquer_fails):
    root = np.random.default_rng(0).standard_normal((60, 60))
    matrix = root @ root.T
    values, vectors = eigh(matrix)
    assert np.all(np.diff(values) > 0)
    np.testing.assert_allclose(vectors * values @ vectors.T, matrix, atol=1e-10)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(60), atol=1e-10)
