"""Vignettes of simulated cameras."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.errors import FormatError, OspcError, SettingError
from ospc.photometry.geometry import half_diagonal
from ospc.simulation import SimulationSettings
from ospc.simulation.responses import VIGNETTES, make_vignette

SIZE = (96, 64)


def settings(**values):
    return SimulationSettings(size=SIZE, **values)


@pytest.mark.parametrize("name", VIGNETTES)
def test_every_vignette_is_positive_and_one_at_its_brightest(name):
    image = make_vignette(settings(vignette=name)).image()
    assert image.shape == SIZE[::-1]
    assert image.min() > 0
    assert image.max() == pytest.approx(1, abs=2e-3)


def test_values_are_those_of_their_definitions():
    corner = np.array([[0.0, 0.0]])
    middle = np.array([(np.array(SIZE) - 1) / 2])
    asked = settings(vignette="polynomial", vignette_coefficients=(-0.3, 0.1, -0.2))
    assert make_vignette(asked).at(corner) == pytest.approx(0.6)
    assert make_vignette(asked).at(middle) == pytest.approx(1)
    natural = settings(vignette="cos4")
    angle = np.arctan(half_diagonal(SIZE) / natural.focal_px)
    assert make_vignette(natural).at(corner) == pytest.approx(np.cos(angle) ** 4, rel=1e-3)
    assert np.all(make_vignette(settings(vignette="none")).image() == 1)


def test_decentred_is_brightest_where_its_centre_is():
    made = make_vignette(settings(vignette="decentred")).image()
    row, column = np.unravel_index(np.argmax(made), made.shape)
    expected = (np.array(SIZE) - 1) / 2 + np.array([0.1, -0.06]) * half_diagonal(SIZE)
    np.testing.assert_allclose([column, row], expected, atol=1)


def test_objects_and_files_are_taken(tmp_path):
    given = log_polynomial(SIZE, (-0.4,))
    assert make_vignette(settings(vignette=given)) is given
    path = tmp_path / "vignette.png"
    cv2.imwrite(str(path), np.rint(given.image() * 65535).astype(np.uint16))
    np.testing.assert_allclose(make_vignette(settings(vignette=str(path))).image(), given.image(), atol=1e-3)


@pytest.mark.parametrize(
    ("values", "error"),
    [
        ({"vignette": "polynomail"}, SettingError),
        ({"vignette": log_polynomial((10, 10), (-0.4,))}, SettingError),
        ({"vignette_coefficients": (-1.5, 0.0, 0.0)}, SettingError),
        ({"vignette_coefficients": (0.5, 0.0, 0.0)}, SettingError),
        ({"vignette": "decentred", "vignette_coefficients": (-1.5, 0.0, 0.0)}, OspcError),
    ],
)
def test_impossible_ones_are_refused(values, error):
    with pytest.raises(error):
        make_vignette(settings(**values))


def test_a_file_that_is_no_image_is_refused(tmp_path):
    path = tmp_path / "vignette.png"
    path.write_bytes(b"not an image")
    with pytest.raises(FormatError, match=r"vignette\.png"):
        make_vignette(settings(vignette=str(path)))
