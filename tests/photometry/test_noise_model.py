"""The noise law, and what clipping does to noisy pixels, against drawing them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.photometry.noise import NoiseModel

variances = st.floats(0, 0.01)
unit = st.floats(0, 1)


@given(variances, variances, unit)
def test_the_variance_is_affine_in_the_grey_level(read, shot, grey):
    assert NoiseModel(read, shot).variance(grey) == pytest.approx(read + shot * grey, abs=1e-15)


@given(variances, variances)
def test_no_grey_level_is_outside_black_and_white(read, shot):
    noise = NoiseModel(read, shot)
    np.testing.assert_array_equal(noise.variance([-1.0, 2.0]), noise.variance([0.0, 1.0]))
    np.testing.assert_array_equal(noise.clipping_bias([-1.0, 2.0]), noise.clipping_bias([0.0, 1.0]))


@pytest.mark.parametrize(("read", "shot"), [(1e-4, 0.0), (4e-4, 1e-3), (1e-6, 4e-3), (2.5e-3, 0.0)])
def test_the_clipping_bias_is_that_of_drawn_pixels(read, shot):
    noise = NoiseModel(read, shot)
    grey = np.linspace(0, 1, 41)
    sigma = np.sqrt(noise.variance(grey))
    # Each draw with its mirror image: what is not clipped then averages to nothing.
    drawn = np.random.default_rng(0).standard_normal((20_000, 1)) * sigma
    clipped = (np.clip(grey + drawn, 0, 1) + np.clip(grey - drawn, 0, 1)) / 2 - grey
    error = clipped.std(axis=0) / np.sqrt(len(drawn))
    assert np.all(np.abs(noise.clipping_bias(grey) - clipped.mean(axis=0)) < 5 * error + 1e-5 * sigma)


@given(variances, variances, unit)
def test_black_clips_upwards_and_white_downwards_alike(read, shot, grey):
    bias = NoiseModel(read, shot).clipping_bias([0.0, 1.0])
    assert bias[0] >= 0 >= bias[1]
    even = NoiseModel(read, 0.0)
    assert even.clipping_bias(grey) == pytest.approx(-even.clipping_bias(1 - grey), abs=1e-12)


def test_the_bias_at_black_is_that_of_a_half_normal():
    assert NoiseModel(1e-4, 0.0).clipping_bias([0.0])[0] == pytest.approx(0.01 / np.sqrt(2 * np.pi))


def test_without_noise_nothing_is_clipped_away():
    np.testing.assert_allclose(NoiseModel(0.0, 0.0).clipping_bias(np.linspace(0, 1, 11)), 0, atol=1e-9)
