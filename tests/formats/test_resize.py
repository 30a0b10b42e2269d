"""Cropping and scaling move the vignette with the pixels of the scene."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from log_polynomials import log_polynomial
from ospc.errors import SettingError
from ospc.formats.resize import (
    crop_calibration,
    resize_calibration,
)
from ospc.photometry.calibration import Calibration
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.photometry.vignette import LogSplineVignette, PolynomialVignette, RasterVignette

SIZE = (96, 72)
POLYNOMIAL = PolynomialVignette(SIZE, (-0.3, 0.1, -0.15))
LOG = log_polynomial(SIZE, (-0.3, -0.1), (0.2, -0.1), (0.06, -0.05, 0.05, -0.03, 0.02, 0.04, -0.05, 0.03))
SPLINE = LogSplineVignette(SIZE, (-0.1, -0.3, -0.9, 0.2), LOG.centre, LOG.non_radial, reach=0.9)
RASTER = RasterVignette(LOG.image())
EVERY = pytest.mark.parametrize(
    "vignette", [POLYNOMIAL, LOG, SPLINE, RASTER], ids=["polynomial", "log", "spline", "raster"]
)


def relative(image: np.ndarray) -> np.ndarray:
    return image / image.max()


def cropped(vignette, offset, size):
    return crop_calibration(Calibration(vignette.size, vignette=vignette), offset, size).vignette


def resized(vignette, size):
    return resize_calibration(Calibration(vignette.size, vignette=vignette), size).vignette


def full(**attributes) -> Calibration:
    return Calibration(
        SIZE,
        Response.gamma(2.0),
        POLYNOMIAL,
        vignette_sigma=np.linspace(0, 0.05, 51),
        noise=NoiseModel(1e-5, 1e-4),
        covariance={"response": {"matrix": []}, "vignette": {"matrix": []}},
        source={"path": "x"},
        **attributes,
    )


@EVERY
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 40), st.integers(0, 30), st.integers(20, 50), st.integers(20, 40))
def test_crop_is_the_part_of_the_image(vignette, x, y, width, height):
    part = cropped(vignette, (x, y), (width, height))
    assert part.size == (width, height)
    expected = vignette.image()[y : y + height, x : x + width]
    np.testing.assert_allclose(relative(part.image()), relative(expected), atol=1e-5)


@EVERY
@pytest.mark.parametrize("size", [(48, 36), (192, 144), (64, 48), (95, 71)])
def test_scaling_samples_the_same_places(vignette, size):
    scaled = resized(vignette, size)
    assert scaled.size == size
    scale = np.array(SIZE) / size
    y, x = np.mgrid[: size[1], : size[0]]
    places = (np.stack([x, y], axis=-1) + 0.5) * scale - 0.5
    inside = np.all((places > 0.5) & (places < np.array(SIZE) - 1.5), axis=-1)
    difference = relative(scaled.image()) - relative(vignette.at(places))
    assert np.abs(difference[inside]).max() < (0.004 if vignette is RASTER or size == (95, 71) else 1e-4)


@pytest.mark.parametrize("vignette", [POLYNOMIAL, LOG])
def test_analytic_models_stay_analytic_and_scaling_back_is_exact(vignette):
    there = resized(vignette, (48, 36))
    assert type(there) is type(vignette)
    np.testing.assert_allclose(resized(there, SIZE).coefficients, vignette.coefficients, rtol=1e-12)
    centred = cropped(vignette, (8, 6), (80, 60))
    assert type(centred) is type(vignette)


@pytest.mark.parametrize("vignette", [POLYNOMIAL, LOG])
def test_crop_moves_the_centre(vignette):
    moved = cropped(vignette, (20, 10), (60, 50))
    old_centre = np.array([47.5, 35.5]) + np.array(vignette.centre) * np.hypot(47.5, 35.5)
    new_centre = np.array([29.5, 24.5]) + np.array(moved.centre) * np.hypot(29.5, 24.5)
    np.testing.assert_allclose(new_centre, old_centre - [20, 10])


def test_calibration_keeps_what_still_holds_and_drops_the_rest():
    resized = resize_calibration(full(), (48, 36))
    assert resized.size == resized.vignette.size == (48, 36)
    assert resized.noise is None
    np.testing.assert_array_equal(resized.vignette_sigma, full().vignette_sigma)
    np.testing.assert_array_equal(resized.response.inverse_table, full().response.inverse_table)
    assert list(resized.covariance) == ["response"]
    assert resized.source == {"path": "x", "resized_to": [48, 36]}

    centred = crop_calibration(full(), (24, 18), (48, 36))
    assert centred.noise == full().noise
    assert centred.vignette_sigma[-1] == pytest.approx(0.05 * np.hypot(47, 35) / np.hypot(95, 71))
    assert crop_calibration(full(), (0, 0), (48, 36)).vignette_sigma is None


def test_unknown_parts_stay_unknown():
    bare = Calibration(SIZE)
    assert crop_calibration(bare, (0, 0), (10, 10)).vignette is None
    assert resize_calibration(bare, (48, 36)).vignette is None


def test_impossible_changes_are_refused():
    for change, reason in (
        (lambda: resized(POLYNOMIAL, (96, 96)), "aspect"),
        (lambda: cropped(POLYNOMIAL, (50, 0), (50, 50)), "not inside"),
        (lambda: cropped(POLYNOMIAL, (-1, 0), (50, 50)), "not inside"),
        (lambda: resized(POLYNOMIAL, (1, 1)), "1×1"),
        (lambda: resized(POLYNOMIAL, (96000, 72000)), "at most"),
        (lambda: resize_calibration(Calibration(SIZE), (96, 96)), "aspect"),
        (lambda: crop_calibration(Calibration(SIZE), (50, 0), (50, 50)), "not inside"),
    ):
        with pytest.raises(SettingError, match=reason):
            change()
