"""Only evidence common to many pairs proves a change of the camera; light and wrong registrations do not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.arrays import FloatArray
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.exposures.table import ExposureTable
from ospc.methods.change_hypotheses import explain
from ospc.methods.prediction_errors import PARTS, ExplainedChange, PairErrors
from ospc.observations import ExposedObservations
from ospc.photometry.response import Response
from ospc.settings import DefaultSettings
from ospc.settings.methods import CHANGE_GREY_KNOTS, MIN_CHANGE_SIGMAS, MIN_EFFECT_LOG
from ospc.simulation.responses import make_response
from synthetic_observations import POLYNOMIAL, SIZE, Camera

USUAL_ERROR = 0.001
SPAN = 60
FRAMES = 72
CAMERA = Camera(make_response("srgb"), POLYNOMIAL)
DARKER_CORNERS = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.8, 0.05, -0.2)))
MUCH_DARKER_CORNERS = log_polynomial(SIZE, (-1.0, 0.05, -0.2))
ANOTHER_RESPONSE = replace(CAMERA, response=make_response("filmic"))


@pytest.fixture(scope="module")
def fit():
    """The fit to the observations before the change."""
    settings = DefaultSettings()
    basis = ResponseBasis(settings.response_intervals, settings.response_functions)
    plan = FitPlan(basis, VignetteBasis(settings.radial_terms), None, settings.rounds)
    return fit_with_chosen_vignette(CAMERA.pairs(0, groups=80, points=200), plan).fit


def course(seed: int) -> FloatArray:
    """Return ln of exposures as set by auto exposure, including some frames before and after."""
    random = np.random.default_rng(seed)
    return np.cumsum(np.convolve(random.normal(0, 0.06, FRAMES + 14), np.ones(5) / 5, mode="valid"))


@dataclass(frozen=True)
class Film:
    """Neighbouring frames of a camera with their recorded exposures."""

    camera: Camera = CAMERA
    moving_frames: int = FRAMES
    fading: float = 0.0
    shaded: float = 0.0
    seed: int = 0
    wrong: int = 0
    tilt: float = 0.0
    rolling: float = 0.0
    glare: float = 0.0

    def pairs(self, fit) -> tuple[list[PairErrors], ExposureTable]:
        random = np.random.default_rng([self.seed, 1])
        true = course(self.seed)
        moving = np.arange(FRAMES)[:, None] < self.moving_frames
        moved = np.cumsum(random.normal(0, 0.02, (FRAMES, 2)) * moving, axis=0) * 3
        rolled = np.random.default_rng([self.seed, 2]).normal(0, self.rolling, FRAMES)
        pairs = []
        for frame in range(5, FRAMES):
            later = frame + (1 if frame % 3 else 4)
            if later >= FRAMES:
                break
            shift = moved[later] - moved[frame]
            place = random.uniform(-1, 1, (300, 2)) * np.array(SIZE) / np.hypot(*SIZE)
            turned = (rolled[later] - rolled[frame]) * place[:, ::-1] * [-1, 1]
            places = np.stack([place, np.clip(place + shift + turned, -0.9, 0.9)], axis=1)
            light = np.array([frame, later]) * self.fading
            # Auto exposure follows light that is lost while the lens is covered, so the grey levels stay as they are.
            compensated = self.shaded * (np.array([frame, later]) % 12 < 6)
            radiance = np.log(0.2) + random.normal(0, 0.6, 300)
            if frame % 20 < self.wrong:
                light = light + np.array([0.0, 0.8])
            log_e = np.log(10) + true[[frame, later]]
            attenuation = self.camera.vignette.at_normalised(places) * np.exp(self.tilt * places[..., 1])
            irradiance = np.exp(radiance[:, None] - np.log(10) + log_e + light) * attenuation
            irradiance = irradiance + self.glare * irradiance.mean(axis=0)
            grey = self.camera.response(irradiance) + random.normal(0, 0.002, (300, 2))
            seen = np.all((grey > 0.03) & (grey < 0.97), axis=1)
            count = int(seen.sum())
            observations = ExposedObservations(
                grey=grey[seen].ravel(),
                log_exposure=np.tile(log_e + compensated, count),
                log_exposure_rate=np.zeros(2 * count),
                position=places[seen].reshape(-1, 2),
                gradient=np.zeros(2 * count),
                grey_variance=np.zeros(2 * count),
                grey_third_moment=np.zeros(2 * count),
                frame_moments=np.zeros((2 * count, 6)),
                surround_moments=np.zeros((2 * count, 2, 7)),
                frame=np.tile([frame, later], count),
                point=np.repeat(np.arange(count), 2),
                group=np.full(2 * count, frame),
            )
            pairs.append(PairErrors.of(observations, fit))
        return pairs, ExposureTable.of(np.log(10) + true)

    def explained(self, fit):
        pairs, exposures = self.pairs(fit)
        return explain(pairs, fit, exposures, USUAL_ERROR, SPAN)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("film", [Film(), Film(fading=-0.004), Film(fading=0.01), Film(wrong=1), Film(wrong=3)])
def test_neither_light_nor_wrong_registrations_are_a_change_of_the_camera(film, seed, fit):
    assert replace(film, seed=seed).explained(fit) is None


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("glare", [-0.1, 0.2])
def test_light_added_to_whole_frames_is_no_change_and_hides_no_darker_corners(glare, seed, fit):
    """The fit knows no glare; less glare than it knows is negative."""
    assert Film(glare=glare, seed=seed).explained(fit) is None
    assert Film(DARKER_CORNERS, glare=glare, seed=seed).explained(fit)[0] == "vignette"


@pytest.fixture(scope="module")
def usual_pairs(fit):
    return Film().pairs(fit)[0]


@pytest.mark.parametrize("shaded", [-1.0, 4.5])
def test_light_that_the_exposure_follows_changes_only_the_error_of_whole_pairs(shaded, fit, usual_pairs):
    usual, other = usual_pairs, Film(shaded=shaded).pairs(fit)[0]
    assert max(abs(one.error - same.error) for one, same in zip(usual, other, strict=True)) > 0.9 * abs(shaded)
    for one, same in zip(usual, other, strict=True):
        for name in ("matrix", "vector", "matrix_beyond_light", "vector_beyond_light", "fit_products", "grey_limits"):
            np.testing.assert_allclose(getattr(same, name), getattr(one, name), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("fading", [0.0, -0.003])
def test_a_change_is_found_and_named(seed, fading, fit):
    def part(camera):
        return Film(camera, seed=seed, fading=fading).explained(fit)[0]

    assert part(DARKER_CORNERS) == "vignette"
    assert part(ANOTHER_RESPONSE) == "response"


@pytest.mark.parametrize("seed", range(4))
def test_if_a_vignette_explains_whole_pairs_far_better_errors_that_follow_the_grey_level_do_not_count(seed, fit):
    """With glare, a fit without it has such errors."""
    grey = np.linspace(0, 1, 256)
    wavy = Response.from_values(CAMERA.response.inverse(grey) * np.exp(0.4 * np.sin(2 * np.pi * grey)))
    part, _ = Film(Camera(wavy, MUCH_DARKER_CORNERS), seed=seed).explained(fit)
    assert part == "vignette"


@pytest.mark.parametrize("seed", range(4))
def test_a_camera_that_pauses_does_not_hide_a_change(seed, fit):
    part, _ = Film(DARKER_CORNERS, moving_frames=FRAMES * 2 // 3, seed=seed).explained(fit)
    assert part == "vignette"


def test_the_size_of_a_change_is_stated_unless_it_is_extrapolated(fit):
    for vignette, size in ((DARKER_CORNERS.vignette, "by -"), (log_polynomial(SIZE, (-3.0,)), "greatly")):
        part, text = Film(replace(CAMERA, vignette=vignette)).explained(fit)
        assert text.startswith(f"the {part} changed {size}")


def test_a_few_pairs_prove_nothing(fit):
    pairs, exposures = Film(DARKER_CORNERS).pairs(fit)
    assert explain(pairs[:20], fit, exposures, USUAL_ERROR, SPAN) is None
    assert explain(pairs, fit, exposures, USUAL_ERROR, FRAMES) is None


def test_the_curve_of_a_response_is_finite_where_pairs_see_black():
    """Both a line in ln g and bends at the knots are evaluated at grey level zero."""
    change = np.zeros(len(CHANGE_GREY_KNOTS) + 3)
    change[PARTS["response"]] = 0.1
    seen = ExplainedChange(
        "response", change, np.eye(len(CHANGE_GREY_KNOTS) + 1), 1.0, 1.0, 1.0, np.array([0.0, 0.5])
    )
    assert np.isfinite(seen.curve).all()
    assert np.isfinite(seen.effect)


@pytest.mark.parametrize("seed", range(3))
def test_a_change_much_larger_than_the_errors_that_show_it_is_not_proven(seed, fit):
    """A camera that hardly moves vertically, and rolls a little, shows little of a vertical slope of ln V."""
    film = Film(tilt=-0.5, rolling=0.02, seed=seed)
    pairs, exposures = film.pairs(fit)
    whole = ExplainedChange.of(pairs, fit, "vignette")
    assert whole.sigmas > MIN_CHANGE_SIGMAS
    assert abs(whole.effect) > MIN_EFFECT_LOG
    assert explain(pairs, fit, exposures, USUAL_ERROR, SPAN) is None
