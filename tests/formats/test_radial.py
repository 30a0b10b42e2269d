"""The shared polynomial: fitted if necessary, and converted between units of radius without changing a pixel."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from log_polynomials import log_polynomial
from ospc.errors import FormatError, SettingError
from ospc.formats.radial import Optics, RadialFit, fit_radial, rescaled
from ospc.photometry.geometry import half_diagonal
from ospc.photometry.vignette import PolynomialVignette, RasterVignette

SIZE = (64, 48)
coefficient = st.floats(-0.2, 0.2)


def test_a_polynomial_needs_no_fit():
    fit = fit_radial(PolynomialVignette(SIZE, (-0.3, 0.1)))
    assert fit.coefficients == (-0.3, 0.1, 0.0)
    assert (fit.rms, fit.worst, fit.note) == (0, 0, "")


@settings(max_examples=20, deadline=None)
@given(coefficient, coefficient, coefficient)
def test_a_map_of_a_polynomial_gives_it_back(v1, v2, v3):
    polynomial = PolynomialVignette(SIZE, (v1, v2, v3))
    fit = fit_radial(RasterVignette(polynomial.image() * np.float32(0.7)))
    assert fit.worst < 1e-5
    assert np.abs(fit.vignette().image() - polynomial.image()).max() < 1e-5


def test_fit_is_the_least_squares_and_states_its_residual():
    vignette = log_polynomial(SIZE, (-0.6, -0.5))
    fit = fit_radial(vignette)
    image = vignette.image().astype(float)
    radius = np.hypot(*np.meshgrid(np.arange(64) - 31.5, np.arange(48) - 23.5)) / half_diagonal(SIZE)
    matrix = np.stack([radius ** (2 * n) for n in range(4)], axis=-1).reshape(-1, 4)
    solution, square, *_ = np.linalg.lstsq(matrix, image.ravel(), rcond=None)
    np.testing.assert_allclose(fit.coefficients, solution[1:] / solution[0], rtol=1e-4)
    assert fit.rms == pytest.approx(float(np.sqrt(square[0] / image.size) / solution[0]), rel=1e-3)
    assert fit.rms < fit.worst
    assert "residual" in fit.note


def test_own_centre_is_kept_on_demand():
    vignette = log_polynomial(SIZE, (-0.3,), (0.2, -0.1))
    own, image_centre = fit_radial(vignette, about_its_centre=True), fit_radial(vignette)
    assert own.centre == (0.2, -0.1)
    assert own.rms < 0.001 < image_centre.rms
    back = own.vignette().image()
    expected = vignette.image() / vignette.image().max()
    assert np.abs(back - expected).max() < 0.003


def test_polynomial_about_its_own_centre_is_kept_or_fitted_about_that_of_the_image():
    vignette = PolynomialVignette(SIZE, (-0.3, 0.1), (0.2, -0.1))
    own, image_centre = fit_radial(vignette, about_its_centre=True), fit_radial(vignette)
    assert (own.coefficients, own.centre, own.worst) == ((-0.3, 0.1, 0.0), (0.2, -0.1), 0)
    assert image_centre.centre == (0, 0)
    assert image_centre.rms > 0.001


def test_dark_surround_does_not_count():
    values = PolynomialVignette(SIZE, (-0.3, 0.0, 0.0)).image().copy()
    values[:, :8] = 0
    assert fit_radial(RasterVignette(values)).coefficients == pytest.approx((-0.3, 0, 0), abs=1e-4)


def test_polynomials_that_reach_zero_are_no_vignettes():
    for coefficients in ((-1.2, 0.0, 0.0), (-4.1, 4.0, 0.0), (float("nan"), 0.0, 0.0)):
        with pytest.raises(FormatError, match="is not a vignette"):
            fit_radial(PolynomialVignette(SIZE, coefficients))
        with pytest.raises(FormatError, match="is not a vignette"):
            RadialFit(SIZE, coefficients, (0.1, 0.0))


@given(
    st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3),
    st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2),
    st.tuples(*[st.integers(-5, 10**9)] * 2),
    st.floats(min_value=5e-324),
)
def test_any_numbers_are_a_positive_vignette_or_refused(coefficients, centre, size, unit):
    try:
        fit = RadialFit(size, rescaled(coefficients, unit), centre)
    except FormatError:
        return
    if size[0] * size[1] <= 10_000:
        image = fit.vignette().image()
        assert image.shape == size[::-1]
        assert np.all(np.isfinite(image))
        assert image.min() >= 0


@given(coefficient, coefficient, coefficient, st.floats(0.3, 5))
def test_change_of_unit_keeps_the_value_at_every_place(v1, v2, v3, unit):
    changed = rescaled((v1, v2, v3), unit)
    for radius in (0.0, 0.3, 1.0):
        before = 1 + sum(v * radius ** (2 * n) for n, v in enumerate((v1, v2, v3), start=1))
        after = 1 + sum(v * (radius / unit) ** (2 * n) for n, v in enumerate(changed, start=1))
        assert before == pytest.approx(after)
    assert rescaled(changed, 1 / unit) == pytest.approx((v1, v2, v3), abs=1e-12)


def test_focal_length_in_either_unit():
    size = (1280, 1024)
    half = half_diagonal(size)
    by_pixels = Optics(focal_px=700.0, crop_factor=5.0)
    focal_mm = by_pixels.focal_in_mm(size)
    assert focal_mm == pytest.approx(700 / half * np.hypot(36, 24) / 2 / 5)
    assert Optics(focal_mm=focal_mm, crop_factor=5.0).focal_ratio(size) == pytest.approx(700 / half)
    with pytest.raises(SettingError, match="focal length"):
        Optics(focal_mm=4.0).focal_ratio(size)
    with pytest.raises(SettingError, match="--focal-mm"):
        Optics(focal_px=700.0).focal_in_mm(size)
    with pytest.raises(SettingError, match="aperture must be positive"):
        Optics(aperture=-1.0)


@pytest.mark.parametrize("size", [(2000, 2000), (600_000, 7), (7, 600_000)])
def test_a_map_needs_little_more_memory_than_its_pixels(size):
    tracemalloc.start()
    try:
        RadialFit(size, (-0.1, 0.0, 0.0), centre=(0.01, 0.0)).vignette().image()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 24 * size[0] * size[1]
