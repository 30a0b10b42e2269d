"""The response model: increasing curves from 0 to 1, close to the responses of real cameras."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.evaluation.metrics import response_rmse
from ospc.simulation.responses import RESPONSES
from ospc.unknown_exposures.response_model import family_of_inverses, learned_model


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4))
def test_every_curve_increases_from_0_to_1(coefficients):
    curve = learned_model().curve(coefficients)
    assert (curve[0], curve[-1]) == (0, pytest.approx(1))
    assert np.all(np.diff(curve) > 0)


@pytest.mark.parametrize("name", RESPONSES)
def test_known_responses_are_near(name):
    model, truth = learned_model(), RESPONSES[name]()
    assert response_rmse(model.response(model.coefficients_of(truth)), truth) < 0.03


def test_inverses_are_those_of_the_family():
    tables = family_of_inverses(256)
    assert np.all(tables[:, 0] == 0)
    assert np.allclose(tables[:, -1], 1)
    assert np.all(np.diff(tables, axis=1) > 0)
