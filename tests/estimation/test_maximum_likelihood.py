"""The default estimator on observations from its model: accurate, unbiased, monotone, with correct sigmas."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from log_polynomials import log_polynomial
from ospc.estimation.effect_choice import fit_with_chosen_effects
from ospc.estimation.effects import Effects
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.maximum_likelihood import fit_model
from ospc.estimation.model import Model
from ospc.estimation.response_basis import ResponseBasis, typical_gamma
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette, with_uncertain_centre
from ospc.evaluation.metrics import log_ratio_error, response_shape_rmse, vignette_pixel_rmse, vignette_rmse
from ospc.methods.paper import solve_kkt
from ospc.observations import ExposedObservations
from ospc.photometry.geometry import along_diagonals, normalised, pixel_grid
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette
from ospc.settings import DefaultSettings
from ospc.settings.vignette import MAX_VIGNETTE_REACH
from ospc.simulation.responses import RESPONSES
from synthetic_observations import NONE, POLYNOMIAL, ROUNDS, SIZE, Camera, reordered

NOISE = NoiseModel(1e-5, 0.0)
GAMMA = Response.gamma(2.0, 2041)
RADIAL_TERMS = DefaultSettings().radial_terms


def fitted(observations, radial=RADIAL_TERMS, intervals=32, **vignette):
    model = Model(ResponseBasis(intervals), VignetteBasis(radial, **vignette), Effects())
    return fit_model(model, NOISE, observations, ROUNDS)


def with_chosen_vignette(observations, widest):
    return fit_with_chosen_vignette(observations, FitPlan(ResponseBasis(32), widest, NOISE, ROUNDS)).fit


@cache
def fit_of_response(name, seed, outliers, /):
    """Return a fit shared by several tests."""
    return fitted(Camera(RESPONSES[name](), outliers=outliers).pairs(seed))


def chance_step_sigma(fit, low, high):
    rows = np.diff(fit.response_basis.log_rows(np.array([low, high])), axis=0)[0]
    n = len(rows)
    return float(np.sqrt(rows @ fit.chance[:n, :n] @ rows))


def log_step(curve, low=0.25, high=0.75):
    """Return ln g(high) − ln g(low) of a fit or a response."""
    if isinstance(curve, Response):
        return float(np.log(curve.inverse(high) / curve.inverse(low)))
    return float(np.diff(curve.response_basis.log_rows([low, high]) @ curve.response_parameters)[0])


def log_fall(fit, radius=1.0):
    """Return ln V at a radius along a diagonal."""
    return float(fit.vignette_basis.log_value(fit.vignette_parameters, np.array([[radius, radius]]) / np.sqrt(2))[0])


def log_sigma(fit, radii):
    return np.array([fit.vignette_errors(SIZE).worst_log_sigma(radius) for radius in radii])


def truly_fallen(vignette, radius=1.0):
    return float(np.log(vignette.profile(radius)))


# Accuracy


@pytest.mark.parametrize("outliers", [0.0, 0.1])
@pytest.mark.parametrize("name", RESPONSES)
def test_responses_and_vignettes_of_all_kinds_are_found(name, outliers):
    camera, fit = Camera(RESPONSES[name]()), fit_of_response(name, 0, outliers)
    response, vignette = fit.response(255), fit.vignette(SIZE)
    knees = name == "tum_narrow"
    assert response_shape_rmse(response, camera.response) < (0.004 if knees else 0.003)
    assert log_ratio_error(response, camera.response) < (0.008 if knees else 0.004)
    assert vignette_rmse(vignette, camera.vignette) < 0.004


@pytest.mark.parametrize(
    "vignette", [NONE, log_polynomial(SIZE, (0.0, -1.5)), log_polynomial(SIZE, (0.2, -0.3, 0.0, -0.4))]
)
def test_vignettes_of_other_shapes_are_found_too(vignette):
    fit = fitted(Camera(GAMMA, vignette).pairs(1))
    assert vignette_rmse(fit.vignette(SIZE), vignette) < 0.006


def test_a_tenth_of_outliers_hardly_changes_the_fit():
    fits = [fitted(Camera(GAMMA, outliers=share).pairs(2)) for share in (0.0, 0.1)]
    assert log_step(fits[0]) == pytest.approx(log_step(fits[1]), abs=0.006)
    assert log_fall(fits[0]) == pytest.approx(log_fall(fits[1]), abs=0.006)


def test_points_seen_many_times_are_used_as_a_whole():
    # Four observations per point: two pairs of the same scene point joined.
    random = np.random.default_rng(3)
    n, log_exposure = 1500, np.log(10) + np.array([-0.9, -0.3, 0.3, 0.9])
    place = random.uniform(-1, 1, (n, 4, 2)) * np.array(SIZE) / np.hypot(*SIZE)
    irradiance = np.exp(random.normal(-1.8, 0.7, (n, 1)) + log_exposure - np.log(10))
    grey = GAMMA(irradiance * POLYNOMIAL.at_normalised(place))
    group = np.arange(n) // 50
    made = ExposedObservations(
        grey=np.clip(grey + random.normal(0, 0.003, grey.shape), 0, 1).ravel(),
        log_exposure=np.tile(log_exposure, n),
        log_exposure_rate=np.zeros(4 * n),
        position=place.reshape(-1, 2),
        gradient=np.zeros(4 * n),
        grey_variance=np.zeros(4 * n),
        grey_third_moment=np.zeros(4 * n),
        frame_moments=np.zeros((4 * n, 6)),
        surround_moments=np.zeros((4 * n, 2, 7)),
        frame=np.tile(np.arange(4), n),
        point=np.repeat(np.arange(n), 4),
        group=np.repeat(group, 4),
    )
    fit = fitted(made)
    assert response_shape_rmse(fit.response(255), GAMMA) < 0.002
    assert vignette_rmse(fit.vignette(SIZE), POLYNOMIAL) < 0.004


def test_the_simplest_vignette_that_explains_the_data_is_chosen():
    widest = VignetteBasis(RADIAL_TERMS, free_centre=True, non_radial=True)
    plain = with_chosen_vignette(Camera(GAMMA).pairs(4), widest)
    assert not plain.vignette_basis.non_radial
    truth = log_polynomial(SIZE, (-0.5, 0.05, -0.2), (0.1, -0.06))
    moved = with_chosen_vignette(Camera(GAMMA, truth).pairs(4), widest)
    assert moved.vignette_basis.free_centre
    np.testing.assert_allclose(moved.vignette_basis.centre(moved.vignette_parameters), truth.centre, atol=0.006)
    assert vignette_pixel_rmse(moved.vignette(SIZE), truth) < 0.004
    skew = log_polynomial(SIZE, (-0.5, 0.05, -0.2), (0.0, 0.0), (0.05, -0.04, 0.1, -0.05, 0.08, 0.0, 0.05, -0.1))
    wide = with_chosen_vignette(Camera(GAMMA, skew).pairs(4), widest)
    assert wide.vignette_basis.non_radial
    assert vignette_pixel_rmse(wide.vignette(SIZE), skew) < 0.006


@cache
def fit_with_free_centre(vignette, /, *, sideways):
    plan = FitPlan(ResponseBasis(32), VignetteBasis(RADIAL_TERMS, free_centre=True), NOISE, ROUNDS)
    return fit_with_chosen_effects(Camera(GAMMA, vignette, sideways=sideways).pairs(4), plan).fit


@pytest.mark.parametrize("height", [-0.08, 0.0, 0.04])
def test_a_centre_that_was_not_seen_may_be_elsewhere(height):
    """If points move horizontally only, a factor on V that depends on y leaves the images unchanged."""
    truth = log_polynomial(SIZE, (-0.7,), (0.0, height))
    fit = fit_with_free_centre(truth, sideways=True)
    errors = fit.vignette_errors(SIZE)
    corners = along_diagonals(np.ones(1), SIZE).reshape(-1, 2)
    wrong = np.log(fit.vignette(SIZE).at_normalised(corners)) - np.log(truth.at_normalised(corners))
    assert np.all(np.abs(wrong) < 2 * errors.worst_log_sigma(1.0))
    assert errors.worst_log_sigma(1.0) > 0.03
    seen = fit_with_free_centre(log_polynomial(SIZE, (-0.7,)), sideways=False)
    assert seen.vignette_errors(SIZE).worst_log_sigma(1.0) < 0.02
    assert not seen.vignette_basis.free_centre


def test_a_free_centre_that_was_hardly_seen_is_more_uncertain_than_by_chance():
    cameras = (Camera(GAMMA, log_polynomial(SIZE, (-0.7,)), sideways=sideways) for sideways in (True, False))
    hardly, seen = (fitted(camera.pairs(4), free_centre=True) for camera in cameras)
    assert with_uncertain_centre(seen) is seen
    before, after = (
        fit.vignette_errors(SIZE).worst_log_sigma(1.0) for fit in (hardly, with_uncertain_centre(hardly))
    )
    assert 2 < after / before < 3.5


@dataclass(frozen=True)
class Elliptic:
    """A vignette with elliptic contours around a centre."""

    centre: tuple[float, float] = (0.0, 0.0)
    fall: float = 0.55
    stretch: float = 1.25

    def at_normalised(self, place):
        x, y = np.moveaxis(place - np.array(self.centre), -1, 0)
        return (1 + self.fall * ((x + 0.3 * y) ** 2 + self.stretch * (y - 0.3 * x) ** 2)) ** -2


def test_a_strongly_elliptic_vignette_is_followed():
    widest = VignetteBasis(RADIAL_TERMS, free_centre=True, non_radial=True)
    vignette = Elliptic(fall=0.8, stretch=1.4)
    seen = Camera(GAMMA, vignette).pairs(5, points=100)
    fit = with_chosen_vignette(seen, widest)
    truth = RasterVignette(vignette.at_normalised(normalised(pixel_grid(SIZE), SIZE)))
    assert vignette_pixel_rmse(fit.vignette(SIZE), truth) < 0.0025


@pytest.mark.parametrize("centre", [(0.06, -0.08), (0.0, 0.0)])
@pytest.mark.parametrize("seed", range(2))
def test_the_centre_of_an_elliptic_vignette_stays_near_the_middle(seed, centre):
    """Non-radial terms describe it only partly, and a shift of the centre is nearly a combination of them."""
    widest = VignetteBasis(RADIAL_TERMS, free_centre=True, non_radial=True)
    vignette = Elliptic(centre)
    everywhere = Camera(GAMMA, vignette).pairs(seed, points=100)
    seen = everywhere.seen_twice(np.linalg.norm(everywhere.position, axis=1) < 0.8)
    fit = with_chosen_vignette(seen, widest)
    assert fit.vignette_basis.non_radial
    assert np.abs(fit.vignette_basis.centre(fit.vignette_parameters)).max() < 0.25
    truth = RasterVignette(vignette.at_normalised(normalised(pixel_grid(SIZE), SIZE)))
    assert vignette_pixel_rmse(fit.vignette(SIZE), truth) < 0.006


@dataclass(frozen=True)
class Mechanical:
    """The shadow of a round stop, which enters a round pupil at a radius: the common area of two circles."""

    begins: float

    def at_normalised(self, place):
        distance = np.maximum(1.5 * (np.linalg.norm(place, axis=-1) - self.begins), 0) / 2
        return 2 / np.pi * (np.arccos(distance) - distance * np.sqrt(1 - distance**2))


@pytest.mark.parametrize("begins", [0.4, 0.6, 0.8])
def test_the_kink_of_a_mechanical_vignette_is_found(begins):
    widest = VignetteBasis(RADIAL_TERMS, free_centre=True, non_radial=True)
    vignette = Mechanical(begins)
    seen = Camera(GAMMA, vignette).pairs(2, points=100)
    fit = with_chosen_vignette(seen, widest)
    truth = RasterVignette(vignette.at_normalised(normalised(pixel_grid(SIZE), SIZE)))
    assert vignette_pixel_rmse(fit.vignette(SIZE), truth) < 0.004
    radii = np.linspace(0.05, 1, 96)
    along = np.stack([radii, np.zeros_like(radii)], axis=1)
    found = fit.vignette_basis.log_value(fit.vignette_parameters, along)
    deviation = (found - np.log(vignette.at_normalised(along))) / log_sigma(fit, radii)
    assert np.sqrt(np.mean(deviation**2)) < 2
    plain = fitted(Camera(GAMMA).pairs(2, points=100))
    assert log_sigma(fit, [1.0]) > log_sigma(plain, [1.0])


def test_a_flat_vignette_has_no_centre():
    widest = VignetteBasis(RADIAL_TERMS, free_centre=True, non_radial=True)
    flat = Camera(GAMMA, log_polynomial(SIZE, (0.0,)))
    for seed in range(5):
        fit = with_chosen_vignette(flat.pairs(seed), widest)
        assert not fit.vignette_basis.free_centre


# Bias


def naive_step(observations):
    """Return the step estimated by the paper's estimator, whose matrix contains noisy grey values."""
    ratio = np.exp(observations.log_exposure[::2] - observations.log_exposure[1::2])
    powers = np.arange(3)
    rows = observations.grey[::2, None] ** powers - ratio[:, None] * observations.grey[1::2, None] ** powers
    low, high = np.polynomial.polynomial.polyval([0.25, 0.75], solve_kkt(rows.T @ rows))
    return float(np.log(high / low))


def test_noise_does_not_flatten_the_response_even_with_small_exposure_ratios():
    # Ratios of up to 8 % change a grey level by less than the noise of 3/255.
    faint = Camera(GAMMA, NONE, read=(3 / 255) ** 2, shot=0.0, registration_sigma_px=0.0, log_ratio=0.08)
    draws = [faint.pairs(seed, points=150) for seed in range(8)]
    fits = [fitted(s, 0, 16) for s in draws]
    truth = log_step(GAMMA)
    # The naive model contains the truth, so its error is due to noise alone.
    naive = np.mean([naive_step(s) for s in draws]) - truth
    assert naive < -0.3
    ours = np.mean([log_step(fit) for fit in fits]) - truth
    assert abs(ours) < abs(naive) / 5
    assert abs(ours) < 1.5 * np.mean([fit.log_response_step_sigma(0.25, 0.75) for fit in fits])


def test_the_fit_is_unbiased_for_the_response_of_the_prior():
    grey = np.linspace(0, 1, 4097)[1:]
    log_g = 1.3 * (typical_gamma(0) * np.log(grey) + (typical_gamma(1) - typical_gamma(0)) * (grey - 1))
    truth = Response.from_values(np.concatenate([[0.0], np.exp(log_g)]))
    camera = Camera(truth, NONE, read=(3 / 255) ** 2, shot=0.0, registration_sigma_px=0.0, log_ratio=0.08)
    steps = [log_step(fitted(camera.pairs(seed, points=200), 0, 16)) for seed in range(8)]
    assert abs(np.mean(steps) - log_step(truth)) < 3 * np.std(steps, ddof=1) / np.sqrt(8)


# Uncertainty


@pytest.mark.parametrize(
    "camera",
    [
        Camera(GAMMA),
        Camera(RESPONSES["srgb"](), outliers=0.05),
        Camera(GAMMA, metadata_error=0.003),
    ],
    ids=["independent errors", "outliers", "errors common to a pair"],
)
def test_stated_sigmas_match_the_errors(camera):
    fits = [fitted(camera.pairs(seed, groups=24, points=70), intervals=16) for seed in range(14)]
    steps = [(0.25, 0.75), (0.15, 0.5)]
    radii = np.array([0.6, 0.9])
    z = []
    for fit in fits:
        error = [log_step(fit, *s) - log_step(camera.response, *s) for s in steps]
        error += [log_fall(fit, r) - truly_fallen(camera.vignette, r) for r in radii]
        sigma = [chance_step_sigma(fit, *s) for s in steps]
        z.append(np.array(error) / [*sigma, *log_sigma(replace(fit, covariance=fit.chance), radii)])
    spread, mean = np.std(z, axis=0), np.mean(z, axis=0)
    assert np.all((spread > 0.5) & (spread < 2))
    assert np.all(np.abs(mean) < 1)


def test_small_errors_that_pairs_of_a_bracket_share_are_within_the_bands():
    """Brackets hardly show changes of ln g that are periodic with their ratio, and such errors look like them."""
    camera, greys = (
        Camera(RESPONSES["srgb"](), log_ratio=np.log(4), bracketed=True, spread=1.3),
        np.linspace(0.1, 0.9, 10),
    )
    z = []
    for seed in range(8):
        seen, random = camera.pairs(seed, groups=40, points=400), np.random.default_rng(seed)
        by_brightness = random.normal(0, 0.001 * camera.log_ratio, 16)
        grey = seen.grey.copy()
        error = by_brightness[(grey[0::2] * 15).astype(int)]
        grey[1::2] = camera.response(camera.response.inverse(grey[1::2]) * np.exp(error))
        fit = fitted(replace(seen, grey=grey))
        wrong = (fit.response_basis.log_rows(greys) - fit.response_basis.log_rows([0.5])) @ fit.response_parameters
        wrong -= np.log(camera.response.inverse(greys) / camera.response.inverse(0.5))
        z.append(wrong / fit.log_response_sigma(greys, 0.5))
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.3


def test_the_sigma_at_the_corners_is_that_of_the_corners_of_the_image():
    """An ellipse, x² − y², is zero on the diagonals of a square, but not at the corners of a wide image."""
    fit = fitted(Camera(GAMMA).pairs(0, groups=10), non_radial=True)
    ellipse = fit.vignette_part.start + fit.vignette_basis.names.index("x2-y2")
    uncertain = fit.covariance.copy()
    uncertain[ellipse, ellipse] += 1.0
    for size, expected in (((480, 480), 0.0), ((1281, 721), (16**2 - 9**2) / (16**2 + 9**2))):
        before, after = (
            replace(fit, covariance=covariance).vignette_errors(size).worst_log_sigma(1.0)
            for covariance in (fit.covariance, uncertain)
        )
        assert np.sqrt(after**2 - before**2) == pytest.approx(expected, abs=1e-4)


def test_the_sigma_of_an_unseen_corner_covers_its_error():
    """V = 1 − 0.35 R² + 0.05 R⁴ − 0.15 R⁶ about a shifted centre; it reaches zero not far beyond the corner."""
    zeros = np.roots([-0.15, 0.05, -0.35, 1.0])
    truth = log_polynomial(SIZE, tuple(-np.sum(zeros**-i).real / i for i in np.arange(1.0, 61.0)), (0.11, 0.08))
    corner = np.array([[-0.8, -0.6]])
    for seed in range(3):
        everywhere = Camera(GAMMA, truth).pairs(seed, groups=40)
        seen = everywhere.seen_twice(np.linalg.norm(everywhere.position - truth.centre, axis=1) < 1.05)
        fit = fitted(seen, DefaultSettings().radial_terms, free_centre=True)
        error = fit.vignette_basis.log_value(fit.vignette_parameters, corner) - truth.log_at_normalised(corner)
        assert abs(error[0]) < 2 * fit.vignette_errors(SIZE).worst_log_sigma(1.0) < 0.25


@dataclass(frozen=True)
class Case:
    """The shadow of a case, which gets ever steeper towards the corners."""

    def at_normalised(self, place):
        radius = np.linalg.norm(place, axis=-1)
        return (1 + 0.3 * radius**2) ** -2 * (1 - 0.75 * np.maximum(2 * radius - 1, 0) ** 1.7)


def test_the_sigma_covers_a_vignette_that_gets_ever_steeper_beyond_the_last_observations():
    corner = np.array([[-0.8, -0.6]])
    deviations = []
    for seed in range(4):
        everywhere = Camera(GAMMA, Case()).pairs(seed, groups=100)
        seen = everywhere.seen_twice(np.linalg.norm(everywhere.position, axis=1) < 0.93)
        fit = fitted(seen)
        error = fit.vignette_basis.log_value(fit.vignette_parameters, corner) - np.log(Case().at_normalised(corner))
        deviations.append(float(error[0]) / fit.vignette_errors(SIZE).worst_log_sigma(1.0))
        assert fit.vignette_errors(SIZE).worst_log_sigma(1.0) < 0.1
        assert fit.vignette_errors(SIZE).worst_log_sigma(0.9) < 0.01
    assert np.sqrt(np.mean(np.square(deviations))) < 2


@dataclass(frozen=True)
class SteepVignette:
    """V = 1 − a R² − b R⁴ about its own centre."""

    a: float
    b: float
    centre: tuple[float, float] = (0.0, 0.0)

    def at_normalised(self, place):
        squared = np.sum((place - np.array(self.centre)) ** 2, axis=-1)
        return 1 - self.a * squared - self.b * squared**2


CORNERS = np.array([[0.8, 0.6], [-0.8, 0.6], [0.8, -0.6], [-0.8, -0.6]])


def corner_errors(truth, seed, seen=0.97):
    """Return a fit to points within a share of each side, the errors of ln V at the corners, and their sigma."""
    everywhere = Camera(GAMMA, truth).pairs(seed, groups=70)
    observations = everywhere.seen_twice(np.all(np.abs(everywhere.position) < seen * CORNERS[0], axis=1))
    fit = with_chosen_vignette(observations, VignetteBasis(RADIAL_TERMS, free_centre=True, reach=MAX_VIGNETTE_REACH))
    error = fit.vignette_basis.log_value(fit.vignette_parameters, CORNERS) - np.log(truth.at_normalised(CORNERS))
    return fit, error, fit.vignette_errors(SIZE).worst_log_sigma(1.0)


@pytest.mark.parametrize("centre", [(0.15, -0.1), (0.2, 0.1), (-0.25, 0.0), (0.12, 0.0)])
def test_the_corner_farthest_from_a_decentred_vignette_is_known_as_stated(centre):
    truth = SteepVignette(0.35, 0.1, centre)
    deviations = []
    for seed in range(3):
        fit, error, sigma = corner_errors(truth, seed)
        assert fit.vignette_basis.spline.reach >= np.linalg.norm(CORNERS - centre, axis=1).max()
        assert np.all(np.abs(error) < 0.03)
        deviations.append(error / sigma)
    assert np.abs(deviations).max() < 2


def test_a_centred_vignette_keeps_its_knots():
    fit, _, _ = corner_errors(SteepVignette(0.35, 0.1), 0)
    assert fit.vignette_basis == VignetteBasis(RADIAL_TERMS)


@pytest.mark.parametrize(("fall", "seen"), [((0.55, 0.3), 0.97), ((0.6, 0.3), 0.97), ((0.55, 0.3), 0.9)])
def test_the_sigma_covers_corners_that_are_nearly_dark(fall, seen):
    deviations = [
        error / sigma for _, error, sigma in (corner_errors(SteepVignette(*fall), s, seen) for s in range(3))
    ]
    assert np.sqrt(np.mean(np.square(deviations))) < 2


def test_disagreement_of_halves_adds_uncertainty():
    camera = Camera(GAMMA)
    observations = camera.pairs(0, groups=60)
    first = fitted(observations, intervals=16)
    # In the second half of the recording, all log exposures are wrong by the same factor.
    later = observations.group > np.median(observations.group)
    wrong = replace(observations, log_exposure=np.where(later, 1.04, 1.0) * observations.log_exposure)
    second = fitted(wrong, intervals=16)
    assert second.log_response_step_sigma(0.25, 0.75) > 1.5 * first.log_response_step_sigma(0.25, 0.75)


def test_a_single_pair_of_frames_gives_no_certainty_without_limit():
    observations = Camera(GAMMA).pairs(0, groups=1, points=2000)
    late = replace(observations, log_exposure=observations.log_exposure + 0.02 * (observations.frame % 2))
    model = Model(ResponseBasis(32), VignetteBasis(0), Effects())
    sigma = [fit_model(model, None, late, rounds).log_response_step_sigma(0.25, 0.75) for rounds in (4, 12)]
    assert sigma[1] == pytest.approx(sigma[0], rel=0.5)
    assert sigma[1] > 0.001


@pytest.mark.parametrize("reference", [0.34, 0.5])
def test_sigmas_cover_bends_too_sharp_for_the_basis(reference):
    truth = RESPONSES["tum_narrow"]()
    fit = fit_of_response("tum_narrow", 3, 0.0)
    greys = np.linspace(0.1, 0.85, 200)

    def log_shape(response):
        return np.log(response.inverse(greys) / response.inverse(reference))

    error = np.abs(log_shape(fit.response(255)) - log_shape(truth)) / fit.log_response_sigma(greys, reference)
    assert np.mean(error < 2) > 0.8
    assert error.max() < 6


@pytest.mark.parametrize("log_ratio", [0.05, 0.08, 0.12])
def test_small_exposure_ratios_suffice_across_a_knee(log_ratio):
    """Only points next to the knee at 0.345 are seen on both sides of it."""
    camera = Camera(
        RESPONSES["tum_narrow"](), NONE, (0.1 / 255) ** 2, (0.2 / 255) ** 2, log_ratio=log_ratio, bracketed=True
    )
    fit = fitted(camera.pairs(0, groups=60, points=400), 0, DefaultSettings().response_intervals)
    assert log_step(fit, 0.2, 0.45) == pytest.approx(log_step(camera.response, 0.2, 0.45), abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_a_small_knee_is_followed(seed):
    """A smooth curve misses it by 0.01 and three to five standard deviations."""
    ends, g = [0.0, 0.8, 1.0], [0.0, 0.8, 1.2]
    truth = Response(np.interp(np.linspace(0, 1, 2041), ends, g) / g[-1])
    fit = fitted(Camera(truth, log_ratio=np.log(3), bracketed=True).pairs(seed), intervals=48)
    greys = np.linspace(0.1, 0.95, 86)
    error = np.log(fit.response(255).inverse(greys) / truth.inverse(greys))
    error -= np.log(fit.response(255).inverse(0.405) / truth.inverse(0.405))
    assert np.abs(error).max() < 0.008
    assert np.abs(error / fit.log_response_sigma(greys, 0.405)).max() < 3


@pytest.mark.parametrize("name", sorted(set(RESPONSES) - {"tum_narrow"}))
def test_smooth_responses_have_no_knees(name):
    assert fit_of_response(name, 0, 0.0).hyperparameters.knees == ()


def test_a_response_with_a_knee_has_one():
    assert fit_of_response("tum_narrow", 3, 0.0).hyperparameters.knees


def test_the_uncertainty_is_not_relative_to_a_level_at_a_sharp_bend():
    fit, bend = fit_of_response("tum_narrow", 3, 0.0), 0.34
    at_bend, elsewhere = fit.response(255, (0.03, 2 * bend - 0.03)), fit.response(255, (0.03, 0.97))
    assert 0.03 < abs(at_bend.reference_grey - bend) < 0.2
    assert elsewhere.reference_grey == 0.5
    assert np.interp(at_bend.reference_grey, at_bend.levels, at_bend.log_sigma) < 1e-6
    assert np.median(at_bend.log_sigma[20:60]) < 0.3 * at_bend.log_sigma[round(255 * bend)]


def test_sigmas_cover_noise_that_was_amplified_after_the_response():
    """Sharpening quadruples the variance of pixels: the measured noise is not the one that the response bends."""
    levels, truth = np.array([12, 16, 22, 30, 40, 60, 80]) / 255, RESPONSES["srgb"]()
    variances = np.interp(np.linspace(0, 1, 25), [0.12, 0.3, 0.9], [4e-4, 2.6e-4, 1.3e-4])
    amplified = NoiseModel(4e-4, 0.0, tuple(variances), measured=(0.12, 0.9))
    model = Model(ResponseBasis(32), VignetteBasis(RADIAL_TERMS), Effects())
    for seed in range(2):
        fit = fit_model(model, amplified, Camera(truth, spread=1.3).pairs(seed, groups=160), ROUNDS)
        error = np.log(fit.response(255).inverse(levels) / truth.inverse(levels))
        error -= np.log(fit.response(255).inverse(0.5) / truth.inverse(0.5))
        sigma = fit.log_response_sigma(levels, 0.5)
        assert np.abs(error[:4]).max() > 0.04
        assert np.sqrt(np.mean((error / sigma) ** 2)) < 2.5
        assert sigma.max() < 0.1


@pytest.mark.parametrize("name", RESPONSES)
def test_error_bounds_are_neither_exceeded_nor_too_wide(name):
    camera = Camera(RESPONSES[name]())
    fits = [fit_of_response(name, seed, 0.0) for seed in range(2)]
    shares = [log_ratio_error(fit.response(255), camera.response) / fit.log_ratio_error_bound for fit in fits]
    shares += [
        vignette_rmse(fit.vignette(SIZE), camera.vignette) / fit.vignette_errors(SIZE).bound(1.0) for fit in fits
    ]
    assert max(shares) < 1.2
    assert np.mean(shares) > 0.15


def test_more_points_make_smaller_deviations():
    few, many = (fitted(Camera(GAMMA).pairs(0, groups=g), intervals=16) for g in (15, 120))
    ratio = chance_step_sigma(few, 0.25, 0.75) / chance_step_sigma(many, 0.25, 0.75)
    assert 1.7 < ratio < 5
    assert log_sigma(many, [1.0]) < log_sigma(few, [1.0])


def test_uncertainty_is_large_where_nothing_was_measured():
    camera = Camera(GAMMA)
    dark = camera.pairs(0)
    below = np.repeat(np.all(dark.grey.reshape(-1, 2) < 0.5, axis=1), 2)
    fit = fitted(dark.where(below))
    assert fit.log_response_step_sigma(0.6, 0.9) > 5 * fit.log_response_step_sigma(0.15, 0.45)
    still = replace(dark, position=np.repeat(dark.position[::2], 2, axis=0))
    assert fitted(still).vignette_errors(SIZE).sigma_at_corner > 0.2


# Invariance


def assert_same_fit(a, b):
    """Assert that two fits differ by no more than the stopping tolerance, 0.1 sigma in any direction."""
    change = a.parameters - b.parameters
    assert np.sqrt(change @ np.linalg.solve(a.covariance, change)) < 0.15
    np.testing.assert_allclose(np.sqrt(np.diag(a.covariance)), np.sqrt(np.diag(b.covariance)), rtol=0.05)


SOME = Camera(RESPONSES["srgb"](), outliers=0.03).pairs(5, groups=20, points=60)


@cache
def fit_of_some(**options):
    return fitted(SOME, **options)


def test_the_order_of_the_points_does_not_matter():
    order = np.random.default_rng(0).permutation(len(SOME.starts))
    assert_same_fit(fit_of_some(), fitted(reordered(SOME, order)))


def test_the_order_of_the_two_frames_does_not_matter():
    swapped = SOME.where(np.arange(len(SOME)).reshape(-1, 2)[:, ::-1].ravel())
    assert_same_fit(fit_of_some(), fitted(swapped))


@pytest.mark.parametrize("factor", [1e-6, 0.5, 2.0, 3e4])
def test_a_factor_on_all_exposures_does_not_matter(factor):
    assert_same_fit(fit_of_some(), fitted(replace(SOME, log_exposure=SOME.log_exposure + np.log(factor))))


@pytest.mark.parametrize("sign", [(-1, 1), (1, -1), (-1, -1)])
def test_mirroring_the_images_mirrors_the_vignette(sign):
    mirrored = replace(SOME, position=SOME.position * sign)
    assert_same_fit(fit_of_some(), fitted(mirrored))
    plain, other = fit_of_some(free_centre=True), fitted(mirrored, free_centre=True)
    centres = [fit.vignette_basis.centre(fit.vignette_parameters) for fit in (plain, other)]
    np.testing.assert_allclose(centres[1], centres[0] * sign, atol=2e-4)
    assert log_step(plain) == pytest.approx(log_step(other), abs=0.1 * plain.log_response_step_sigma(0.25, 0.75))


def test_the_same_observations_give_the_same_fit_bit_for_bit():
    one, other = fit_of_some(), fitted(SOME)
    np.testing.assert_array_equal(one.parameters, other.parameters)
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_fit_may_start_from_another_and_ends_at_the_same():
    model = Model(ResponseBasis(32), VignetteBasis(4), Effects())
    first = fit_model(model, NOISE, SOME, ROUNDS)
    again = fit_model(model, NOISE, SOME, ROUNDS, first)
    assert log_step(again) == pytest.approx(log_step(first), abs=0.003)
    assert log_fall(again) == pytest.approx(log_fall(first), abs=0.003)


# Monotonicity on arbitrary input

values = st.one_of(st.sampled_from([0.0, 1.0, 0.5, 1 / 255]), st.floats(0, 1))


@st.composite
def nasty_observations(draw):
    """Draw observations that no real camera would produce."""
    points = draw(st.integers(3, 60))
    seen = draw(st.integers(2, 4))
    n = points * seen
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    grey = random.choice(draw(st.lists(values, min_size=1, max_size=8)), n)
    if draw(st.booleans()):
        grey = np.clip(grey + random.normal(0, 0.2, n), 0, 1)
    exposures = random.choice(draw(st.lists(st.floats(-8, 8), min_size=1, max_size=5)), n)
    if draw(st.booleans()):
        # Brighter pixels get shorter exposures, contrary to any response.
        exposures = -5 * grey
    return ExposedObservations(
        grey=grey,
        log_exposure=exposures.astype(float),
        log_exposure_rate=np.zeros(len(exposures)),
        position=random.uniform(-0.7, 0.7, (n, 2)) * draw(st.sampled_from([0.0, 1e-6, 1.0])),
        gradient=random.choice(draw(st.lists(st.floats(0, 0.1), min_size=1, max_size=3)), n).astype(float),
        grey_variance=np.zeros(n),
        grey_third_moment=np.zeros(n),
        frame_moments=np.zeros((n, 6)),
        surround_moments=np.zeros((n, 2, 7)),
        frame=np.tile(np.arange(seen), points),
        point=np.repeat(np.arange(points), seen),
        group=np.sort(random.integers(0, draw(st.integers(1, 9)), points)).repeat(seen),
    )


@settings(max_examples=20)
@given(nasty_observations(), st.booleans())
def test_a_response_increases_strictly_and_deviations_are_finite_whatever_was_seen(observations, free_centre):
    fit = fitted(observations, 2, 16, free_centre=free_centre)
    assert np.all(np.isfinite(fit.parameters))
    assert np.all(np.diff(fit.response_basis.log_of(fit.response_parameters)) > 0)
    for max_grey in (255, 4095):
        response = fit.response(max_grey)
        assert np.all(np.diff(response.inverse_table) > 0)
        assert np.all(np.isfinite(response.inverse_sigma))
    assert np.linalg.eigvalsh(fit.covariance).min() > -1e-6 * np.abs(fit.covariance).max()
    assert np.all(np.isfinite(fit.vignette((16, 12)).image()))
