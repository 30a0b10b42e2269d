"""The noise of a grey value: an affine model, or a table of measured variances."""

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
def test_grey_levels_are_clipped_to_black_and_white(read, shot):
    noise = NoiseModel(read, shot)
    np.testing.assert_array_equal(noise.variance([-1.0, 2.0]), noise.variance([0.0, 1.0]))


def test_a_table_replaces_the_affine_law_and_is_interpolated():
    noise = NoiseModel(1.0, 1.0, table=(0.0, 4e-4, 1e-4))
    np.testing.assert_allclose(noise.variance([0.0, 0.25, 0.5, 1.0]), [0.0, 2e-4, 4e-4, 1e-4], atol=1e-18)
