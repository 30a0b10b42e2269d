"""The response model: increasing curves from 0 to 1, close to the responses of real cameras."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.errors import FormatError
from ospc.evaluation.metrics import response_rmse
from ospc.settings.unknown_exposures import RESPONSE_SAMPLES
from ospc.simulation.responses import RESPONSES
from ospc.unknown_exposures.response_model import family_of_inverses, learned_model, read_model


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


def test_the_published_tables_are_read_and_cover_the_learned_model(real_data):
    model = read_model(real_data / "responses" / "emor.txt")
    assert model.components.shape == (4, RESPONSE_SAMPLES)
    for name, make in RESPONSES.items():
        if name != "log":
            assert response_rmse(model.response(model.coefficients_of(make())), make()) < 0.03


@pytest.mark.parametrize(
    "text",
    [
        "",
        "f0=\n1 2 3\n",
        "f0 =\nx y\n",
        "f0=\n" + "nan " * 1024 + "".join(f"\nh({i})=\n" + "1 " * 1024 for i in range(1, 5)),
    ],
)
def test_files_that_are_no_model_are_refused(tmp_path, text):
    place = tmp_path / "emor.txt"
    place.write_text(text)
    with pytest.raises(FormatError, match=r"emor\.txt"):
        read_model(place)
