"""Responses of simulated cameras."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.errors import FormatError, SettingError
from ospc.photometry.response import Response
from ospc.simulation.responses import RESPONSES, make_response

GREY = np.linspace(0, 1, 256)


@pytest.mark.parametrize("name", RESPONSES)
def test_every_response_rises_strictly_from_black_to_white(name):
    response = make_response(name)
    assert response.inverse_table.size >= 1024
    table = response.resampled(256).astype(np.float32)
    assert np.all(np.diff(table) > 0)
    assert (table[0], table[-1]) == (0, 1)
    np.testing.assert_allclose(response(response.inverse(GREY)), GREY, atol=1e-12)
    assert response.model["name"]


def test_values_are_those_of_their_definitions():
    narrow = make_response("tum_narrow")
    np.testing.assert_allclose(narrow.inverse(np.array([0, 88, 188, 255]) / 255), [0, 0.068, 0.464, 1], atol=1e-12)
    np.testing.assert_allclose(narrow.inverse(np.array([44, 138]) / 255), [0.034, 0.266], atol=1e-12)
    assert make_response("srgb")(0.18) == pytest.approx(0.4613, abs=1e-4)
    assert make_response("srgb")(0.001) == pytest.approx(0.01292, abs=1e-6)
    np.testing.assert_allclose(make_response("gamma2.2").inverse(GREY), GREY**2.2, atol=1e-6)
    np.testing.assert_allclose(make_response("linear")(GREY), GREY, atol=1e-12)
    light = np.geomspace(1e-3, 1, 50)
    np.testing.assert_allclose(make_response("log")(light), np.log1p(50 * light) / np.log(51), atol=1e-5)
    power, half = light**1.25, 0.18**1.25
    np.testing.assert_allclose(make_response("filmic")(light), (1 + half) * power / (power + half), atol=1e-4)


def test_filmic_has_a_toe_and_a_shoulder():
    slope = np.diff(make_response("filmic")(np.linspace(0, 1, 200)))
    assert 0 < np.argmax(slope) < 60
    assert slope[-1] < slope.max() / 5


def test_a_response_object_is_taken_as_it_is():
    response = Response.gamma(1.7, 1024)
    assert make_response(response) is response


def test_a_file_gives_its_values(tmp_path):
    path = tmp_path / "pcalib.txt"
    path.write_text(" ".join(f"{v:.9g}" for v in GREY**1.5 * 255) + "\n")
    np.testing.assert_allclose(make_response(str(path)).inverse(GREY), GREY**1.5, atol=1e-8)


@pytest.mark.parametrize(
    "content",
    ["", "1 2 3", " ".join(["7"] * 256), "nan " * 256, " ".join(map(str, range(255))) + " x", "\xff\xfe"],
)
def test_a_file_that_is_no_response_is_refused(tmp_path, content):
    path = tmp_path / "pcalib.txt"
    path.write_text(content, encoding="latin-1")
    with pytest.raises(FormatError, match=r"pcalib\.txt"):
        make_response(path)


def test_an_unknown_name_is_refused():
    with pytest.raises(SettingError, match=r"gamma2\.2"):
        make_response("gama")
