"""Vignettes: one at the centre, symmetric, and the same value from every accessor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import RegularGridInterpolator

from ospc.errors import FormatError
from ospc.photometry.geometry import half_diagonal, normalised, pixel_grid
from ospc.photometry.non_radial import NON_RADIAL
from ospc.photometry.vignette import (
    LogSplineVignette,
    PolynomialVignette,
    RasterVignette,
    half_diagonal_profiles,
    radial_profile,
    unknown_part_in_words,
    usable_radius_of,
)

sizes = st.tuples(st.integers(2, 30), st.integers(2, 30))
small = st.floats(-0.3, 0.3)
pairs = st.tuples(small, small)
triples = st.tuples(small, small, small)
directed = st.tuples(*[small] * len(NON_RADIAL))
polynomials = st.builds(PolynomialVignette, sizes, triples)
reaches = st.floats(0.3, 1.3)
radial_logs = st.builds(LogSplineVignette, sizes, triples, reach=reaches)
logs = st.builds(LogSplineVignette, sizes, triples, st.tuples(small, small), directed, reach=reaches)
of_two_knots = st.builds(LogSplineVignette, sizes, pairs, st.tuples(small, small), directed, reach=st.just(2.0))
rasters = sizes.flatmap(
    lambda s: st.builds(RasterVignette, arrays(np.float32, s[::-1], elements=st.floats(0.125, 1.0, width=32)))
)


def centre_of(size):
    return (np.array(size) - 1) / 2


@given(sizes)
def test_the_corners_are_at_radius_one_and_the_centre_at_zero(size):
    corners = np.array([[0, 0], [size[0] - 1, 0], [0, size[1] - 1], [size[0] - 1, size[1] - 1]], dtype=float)
    np.testing.assert_allclose(np.linalg.norm(normalised(corners, size), axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(normalised(centre_of(size), size), 0, atol=1e-12)
    assert half_diagonal(size) == pytest.approx(np.linalg.norm(corners[3]) / 2)


@given(polynomials, st.floats(0, 1))
def test_a_centred_vignette_is_the_same_along_all_half_diagonals(vignette, radius):
    found = half_diagonal_profiles(vignette, np.array([radius]))
    assert found == pytest.approx(np.full((1, 4), vignette.profile(radius)), rel=1e-9)


@given(st.one_of(polynomials, radial_logs))
def test_nothing_is_lost_at_the_centre(vignette):
    assert vignette.at(centre_of(vignette.size)) == pytest.approx(1, abs=1e-12)
    assert vignette.profile(0.0) == 1


@given(st.one_of(logs, st.builds(PolynomialVignette, sizes, triples, st.tuples(small, small))))
def test_a_vignette_of_its_own_centre_is_one_there(vignette):
    at_its_centre = centre_of(vignette.size) + np.array(vignette.centre) * half_diagonal(vignette.size)
    assert vignette.at(at_its_centre) == pytest.approx(1, abs=1e-9)


@given(st.one_of(polynomials, radial_logs), st.floats(0, 1), st.lists(st.floats(0, 7), min_size=2, max_size=5))
def test_radial_models_are_the_same_all_around(vignette, radius, angles):
    around = radius * half_diagonal(vignette.size) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    np.testing.assert_allclose(vignette.at(centre_of(vignette.size) + around), vignette.profile(radius), rtol=1e-9)


@given(st.one_of(polynomials, radial_logs))
def test_radial_models_are_their_own_mirror_image(vignette):
    image = vignette.image()
    np.testing.assert_allclose(image, image[:, ::-1], rtol=1e-6)
    np.testing.assert_allclose(image, image[::-1], rtol=1e-6)


@given(logs)
def test_a_mirrored_vignette_is_that_of_the_mirrored_image(vignette):
    (x, y), terms = vignette.centre, np.array(vignette.non_radial)
    in_x, in_y = np.array([-1, 1, -1, 1, -1, 1, -1, 1]), np.array([1, -1, -1, 1, 1, -1, -1, 1])
    mirrored = replace(vignette, centre=(-x, y), non_radial=tuple(in_x * terms))
    np.testing.assert_allclose(mirrored.image(), vignette.image()[:, ::-1], rtol=1e-6)
    upside_down = replace(vignette, centre=(x, -y), non_radial=tuple(in_y * terms))
    np.testing.assert_allclose(upside_down.image(), vignette.image()[::-1], rtol=1e-6)


@given(st.one_of(polynomials, logs, rasters))
def test_the_image_is_what_is_said_of_each_pixel(vignette):
    image = vignette.image()
    assert image.shape == vignette.size[::-1]
    assert image.dtype == np.float32
    np.testing.assert_allclose(image, vignette.at(pixel_grid(vignette.size)), rtol=1e-6)


@given(st.one_of(polynomials, logs, rasters), st.floats(0, 1), st.floats(0, 1))
def test_one_point_and_many_have_the_same_value(vignette, right, down):
    point = np.array([right, down]) * (np.array(vignette.size) - 1)
    alone = vignette.at(point)
    assert alone.shape == ()
    assert vignette.at([point]).shape == (1,)
    assert vignette.at(np.empty((0, 2))).shape == (0,)
    several = vignette.at(np.broadcast_to(point, (2, 3, 2)))
    assert several.shape == (2, 3)
    np.testing.assert_allclose(several, alone, rtol=1e-12)


@given(polynomials, st.floats(0, 1.5))
def test_a_polynomial_is_its_formula(vignette, radius):
    v1, v2, v3 = vignette.coefficients
    assert vignette.profile(radius) == pytest.approx(1 + v1 * radius**2 + v2 * radius**4 + v3 * radius**6, abs=1e-12)


@given(of_two_knots, st.floats(-1, 1), st.floats(-1, 1))
def test_a_logarithmic_vignette_is_its_formula(vignette, right, down):
    x, y = right - vignette.centre[0], down - vignette.centre[1]
    squared = x**2 + y**2
    first, last = vignette.coefficients
    expected = first * squared + (last - first) * (squared / vignette.reach) ** 2 / 2
    terms = np.array([x, y, x * y, x**2 - y**2])
    terms = [*terms, *(squared * terms)]
    expected += np.dot(vignette.non_radial, terms)
    assert np.log(vignette.at_normalised(np.array([right, down]))) == pytest.approx(expected, abs=1e-9)


@given(rasters, st.lists(st.tuples(st.floats(-0.5, 1.5), st.floats(-0.5, 1.5)), min_size=1, max_size=20))
def test_a_map_is_read_bilinearly_and_continued_at_its_border(vignette, places):
    width, height = vignette.size
    points = np.array(places) * (width - 1, height - 1)
    reference = RegularGridInterpolator((np.arange(height), np.arange(width)), vignette.values.astype(float))
    inside = np.clip(points, 0, (width - 1, height - 1))
    np.testing.assert_allclose(vignette.at(points), reference(inside[:, ::-1]), atol=1e-6)


@given(rasters, st.floats(0.01, 1000))
def test_a_map_is_known_up_to_scale(vignette, scale):
    assert vignette.values.max() == 1
    np.testing.assert_allclose(RasterVignette(vignette.values * scale).values, vignette.values, rtol=1e-5)


@pytest.mark.parametrize(
    "values",
    [np.ones(4), np.ones((2, 2, 2)), np.zeros((3, 3)), np.array([[1.0, np.nan]]), np.array([[1.0, -0.1]]), [[]]],
)
def test_what_is_no_map_is_refused(values):
    with pytest.raises(FormatError, match="vignette map"):
        RasterVignette(np.array(values, dtype=np.float32))


def test_a_map_is_a_value_that_nobody_can_change():
    source = np.full((2, 3), 0.5, dtype=np.float32)
    source[0, 0] = 1.0
    vignette = RasterVignette(source)
    source[1, 1] = 0.1
    assert vignette.values[1, 1] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        vignette.values[0, 0] = 0


def test_the_radial_profile_is_the_mean_of_the_polynomial_in_each_ring():
    vignette = PolynomialVignette((160, 120), (-0.4, 0.1, -0.05))
    radius = np.linalg.norm(normalised(pixel_grid((160, 120)), (160, 120)), axis=-1)
    rings = [
        vignette.profile(radius[(radius >= low) & ((radius < low + 0.02) | (low > 0.97))]).mean()
        for low in np.arange(50) / 50
    ]
    profile = radial_profile(vignette)
    np.testing.assert_allclose(profile, rings / np.mean(rings[:3]), atol=1e-6)
    middles = vignette.profile((np.arange(50) + 0.5) / 50)
    np.testing.assert_allclose(profile, middles / middles[:3].mean(), atol=0.004)


@pytest.mark.parametrize(("side", "bins", "unknown"), [(3, 10, 7), (10, 10, 1), (10, 50, 36)])
def test_rings_without_a_pixel_are_unknown(side, bins, unknown):
    profile = radial_profile(PolynomialVignette((side, side), (0.0, 0.0, 0.0)), bins)
    assert np.isnan(profile).sum() == unknown
    np.testing.assert_allclose(profile[np.isfinite(profile)], 1)


@pytest.mark.parametrize(("limit", "said"), [(2.2, ""), (1.5, "beyond 1.50 half diagonals from its centre")])
def test_a_part_of_an_image_may_lie_within_or_beyond_what_is_known(limit, said):
    cropped = LogSplineVignette((64, 48), (-0.3, -0.3), centre=(1.2, 0.0), limit=limit)
    assert unknown_part_in_words(cropped).startswith(said)
    assert bool(unknown_part_in_words(cropped)) is bool(said)
    assert 0 <= usable_radius_of(cropped) <= 1
