"""Autoregressive models against series whose model is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.arrays import FloatArray
from ospc.estimation.autoregression import UNCORRELATED, Autoregression
from ospc.settings.estimation import LONGEST_GAIN_MEMORY


def series(coefficients: list[float], count: int, seed: int = 0) -> FloatArray:
    """Return a series with innovations of variance 1."""
    new = np.random.default_rng(seed).standard_normal(count + 500)
    found = np.zeros_like(new)
    order = len(coefficients)
    for i in range(order, len(new)):
        found[i] = new[i] + found[i - order : i][::-1] @ coefficients
    return found[500:]


@pytest.mark.parametrize("coefficients", [[0.8], [-0.5], [1.4, -0.6], [0.3, 0.0, 0.4]])
def test_the_model_is_found(coefficients: list[float]) -> None:
    values = series(coefficients, 20_000)
    found = Autoregression.of(values)
    known = np.zeros(LONGEST_GAIN_MEMORY)
    known[: len(coefficients)] = coefficients
    assert np.pad(found.coefficients, (0, LONGEST_GAIN_MEMORY - len(found.coefficients))) == pytest.approx(
        known, abs=0.04
    )
    assert found.new_share == pytest.approx(1 / np.var(values), rel=0.05)


@settings(max_examples=20, deadline=None)
@given(first=st.floats(-0.9, 0.9), seed=st.integers(0, 9999))
def test_what_is_left_is_uncorrelated_and_varies_as_much(first: float, seed: int) -> None:
    values = series([first], 600, seed)
    left = Autoregression.of(values).whitened(values)
    assert left.shape == values.shape
    assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) < 0.15
    assert np.var(left) == pytest.approx(np.var(values), rel=0.15)


def test_rows_are_whitened_column_by_column() -> None:
    values = np.stack([series([0.7], 200, seed) for seed in range(3)], axis=1)
    found = Autoregression.of(values[:, 0])
    np.testing.assert_allclose(found.whitened(values)[:, 2], found.whitened(values[:, 2]))


@pytest.mark.parametrize("values", [np.zeros(50), np.ones(3), np.empty(0)])
def test_too_little_tells_no_correlation(values: FloatArray) -> None:
    assert len(Autoregression.of(values).coefficients) == 0
    assert UNCORRELATED.whitened(values) is values
