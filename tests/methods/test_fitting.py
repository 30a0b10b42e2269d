"""Fitting to correspondences supplied by the user."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ospc
from ospc.errors import ExposureError, NotObservableError, SettingError
from ospc.estimation.response_basis import FUNCTIONS, ResponseBasis
from ospc.evaluation.metrics import response_shape_rmse, vignette_rmse
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.settings import DefaultSettings, FastSettings, PaperSettings
from response_functions import HatsCrowdedAtBlack
from synthetic_observations import NONE, POLYNOMIAL, SIZE, Camera

GAMMA = Response.gamma(2.2)
NOISE = NoiseModel((2 / 255) ** 2, (4 / 255) ** 2)


def made(camera, seed=0, **size):
    """Return observations simulated from the true model, and the exposures by frame number."""
    exposed = camera.pairs(seed, **size)
    exposures_ms = np.full(int(exposed.frame.max()) + 1, np.nan)
    exposures_ms[exposed.frame] = np.exp(exposed.log_exposure)
    return exposed, exposures_ms


def columns(exposed):
    """Return the arguments of ``of_pairs`` for pairs of observations."""
    both = [(values[0::2], values[1::2]) for values in (exposed.grey, exposed.position, exposed.frame)]
    return [values for pair in both for values in pair]


def as_pairs(exposed, **changes):
    gradients = {"gradient0": exposed.gradient[0::2], "gradient1": exposed.gradient[1::2]}
    return ospc.Observations.of_pairs(*columns(exposed), **gradients, **changes)


def test_response_and_vignette_are_found():
    exposed, exposures_ms = made(Camera(GAMMA))
    found = ospc.fit(as_pairs(exposed), exposures_ms, noise=NOISE)
    assert response_shape_rmse(found.response(), GAMMA) < 0.006
    assert vignette_rmse(found.vignette(SIZE), POLYNOMIAL) < 0.006
    assert found.vignette_errors(SIZE).sigma_at_corner < 0.05


def test_a_calibration_from_own_observations_is_saved_like_any_other(tmp_path):
    exposed, exposures_ms = made(Camera(GAMMA))
    pairs = as_pairs(exposed)
    found = ospc.calibrate_observations(pairs, exposures_ms, SIZE, noise=NOISE)
    fitted = ospc.fit(pairs, exposures_ms, noise=NOISE)
    np.testing.assert_array_equal(found.response.inverse_table, fitted.response().inverse_table)
    np.testing.assert_array_equal(found.vignette.image(), fitted.usable_vignette(SIZE).image())
    assert {name: verdict.state for name, verdict in found.verdicts.items()}.keys() == {"response", "vignette"}
    assert found.counts["pairs"] == len(np.unique(exposed.group))
    assert response_shape_rmse(ospc.Calibration.load(found.save(tmp_path / "a.json")).response, GAMMA) < 0.006


def test_a_calibration_of_a_stationary_camera_has_no_vignette():
    exposed, exposures_ms = made(Camera(GAMMA, vignette=NONE))
    found = ospc.calibrate_observations(as_pairs(exposed), exposures_ms, SIZE, vignette=False, max_grey=4095)
    assert found.vignette is None
    assert found.verdicts["vignette"].state == "not identifiable"
    assert (found.max_grey, found.response.inverse_table.size) == (4095, 4096)


@pytest.mark.parametrize("size", [(640,), (0, 480), (640.5, 480), "640x480", None, (10**9, 10**9), (np.inf, 480)])
def test_sizes_of_no_image_are_rejected(size):
    exposed, exposures_ms = made(Camera(GAMMA), groups=8)
    with pytest.raises(SettingError, match="give width and height"):
        ospc.calibrate_observations(as_pairs(exposed), exposures_ms, size)


def test_the_vignette_goes_on_beyond_the_observations():
    exposed, exposures_ms = made(Camera(GAMMA), groups=15)
    inside = np.logical_and.reduceat(np.linalg.norm(exposed.position, axis=1) < 0.7, exposed.starts)
    found = ospc.fit(exposed.of_points(inside), exposures_ms, noise=NOISE)
    assert found.vignette_basis.usable_radius < 0.7
    assert found.vignette(SIZE).limit == np.inf
    assert found.usable_vignette(SIZE).limit < 0.8


def test_points_may_lie_on_a_line():
    exposed, exposures_ms = made(Camera(GAMMA))
    radius = np.linalg.norm(exposed.position, axis=1)
    on_line = np.stack([np.copysign(radius, exposed.position[:, 0]), np.zeros_like(radius)], axis=1)
    found = ospc.fit(as_pairs(replace(exposed, position=on_line)), exposures_ms, noise=NOISE)
    assert response_shape_rmse(found.response(), GAMMA) < 0.006


def inverse(exposures_ms):
    return 1000 / exposures_ms


def of_other_frames(exposures_ms):
    return np.random.default_rng(0).permutation(exposures_ms)


@pytest.mark.parametrize("wrong", [inverse, of_other_frames])
@pytest.mark.parametrize("vignette", [True, False])
def test_wrong_exposures_are_refused(wrong, vignette):
    exposed, exposures_ms = made(Camera(GAMMA))
    with pytest.raises(ExposureError, match="of a typical change of exposure does not show in the grey levels"):
        ospc.fit(as_pairs(exposed), wrong(exposures_ms), noise=NOISE, vignette=vignette)


def one_frame_later(exposures_ms):
    return np.roll(exposures_ms, 1)


def one_frame_earlier(exposures_ms):
    return np.roll(exposures_ms, -1)


def inexact(exposures_ms):
    return exposures_ms * np.exp(np.random.default_rng(0).normal(0, 0.5, len(exposures_ms)))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (inverse, "not their inverse"),
        (one_frame_later, "frame numbers seem to be one too low"),
        (one_frame_earlier, "frame numbers seem to be one too high"),
        (inexact, "exposures are inexact or of other frames"),
        (of_other_frames, "exposures are inexact or of other frames"),
    ],
)
def test_the_reason_for_unexplained_exposures_is_named(wrong, said):
    exposed, exposures_ms = made(Camera(GAMMA))
    number = np.random.default_rng(3).permutation(len(exposures_ms))  # exposures of neighbours are unrelated
    exposures_ms[number] = exposures_ms.copy()
    mixed = as_pairs(replace(exposed, frame=number[exposed.frame]))
    with pytest.raises(ExposureError, match=said):
        ospc.fit(mixed, wrong(exposures_ms), noise=NOISE, vignette=False)


def test_clipped_points_are_named_as_the_reason():
    exposed, exposures_ms = made(Camera(GAMMA))
    brighter = replace(exposed, grey=np.minimum(exposed.grey + 0.7, 1.0))
    with pytest.raises(ExposureError, match=r"\d+% of the grey levels are clipped at 1: leave out"):
        ospc.fit(as_pairs(brighter), exposures_ms, noise=NOISE, vignette=False)


def test_pairs_keep_every_value():
    exposed, _ = made(Camera(GAMMA), groups=5, points=20)
    pairs = as_pairs(exposed)
    for name in ("grey", "position", "gradient", "frame", "point", "group"):
        np.testing.assert_array_equal(getattr(pairs, name), getattr(exposed, name))


def test_a_factor_on_all_exposures_changes_nothing():
    exposed, exposures_ms = made(Camera(GAMMA), groups=15)
    plain, scaled = (ospc.fit(as_pairs(exposed), factor * exposures_ms, noise=NOISE) for factor in (1.0, 8.0))
    np.testing.assert_allclose(scaled.parameters, plain.parameters, rtol=1e-4, atol=1e-5)


def test_points_of_unknown_exposure_are_left_out():
    exposed, exposures_ms = made(Camera(GAMMA), groups=15)
    lost = exposures_ms.copy()
    lost[4] = np.nan
    without = exposed.of_points(~np.any(exposed.frame.reshape(-1, 2) == 4, axis=1))
    np.testing.assert_array_equal(
        ospc.fit(exposed, lost, noise=NOISE).parameters, ospc.fit(without, exposures_ms, noise=NOISE).parameters
    )


def test_a_camera_that_stood_still_has_a_response_without_a_vignette():
    exposed, exposures_ms = made(Camera(GAMMA, NONE))
    still = replace(exposed, position=np.repeat(exposed.position[::2], 2, axis=0))
    with pytest.raises(NotObservableError, match="vignette=False"):
        ospc.fit(still, exposures_ms, noise=NOISE)
    found = ospc.fit(still, exposures_ms, noise=NOISE, vignette=False)
    assert response_shape_rmse(found.response(), GAMMA) < 0.006
    assert len(found.vignette_basis) == 0


def test_a_preset_can_be_given_by_its_name():
    exposed, exposures_ms = made(Camera(GAMMA), groups=15)
    named, given = (ospc.fit(exposed, exposures_ms, settings=chosen) for chosen in ("fast", FastSettings()))
    np.testing.assert_array_equal(named.parameters, given.parameters)


@pytest.mark.parametrize("settings", ["paper", "nonsense", PaperSettings(), 3, None])
def test_settings_of_another_method_are_refused(settings):
    exposed, exposures_ms = made(Camera(GAMMA), groups=2)
    with pytest.raises(SettingError):
        ospc.fit(exposed, exposures_ms, settings=settings)


def test_too_few_points_are_refused():
    exposed, exposures_ms = made(Camera(GAMMA))
    least = DefaultSettings().min_points
    with pytest.raises(NotObservableError, match=f"only {least - 1} scene points"):
        ospc.fit(exposed.of_points(slice(least - 1)), exposures_ms)
    with pytest.raises(NotObservableError, match="only 0 scene points"):
        ospc.fit(exposed, np.full(len(exposures_ms), np.nan))
    none = ospc.Observations.of_pairs([], [], np.empty((0, 2)), np.empty((0, 2)), [], [])
    with pytest.raises(NotObservableError, match="only 0 scene points"):
        ospc.fit(none, exposures_ms)


def test_constant_exposures_are_refused():
    exposed, exposures_ms = made(Camera(GAMMA))
    with pytest.raises(NotObservableError, match="different exposures"):
        ospc.fit(exposed, np.full(len(exposures_ms), 8.0))
    # Exposures that change only from pair to pair carry no information either.
    between = 2.0 ** (np.arange(len(exposures_ms)) // 2 % 5)
    with pytest.raises(NotObservableError, match="different exposures"):
        ospc.fit(exposed, between)


def test_a_few_points_at_different_exposures_do_not_determine_a_response():
    exposed, _ = made(Camera(GAMMA), groups=15)
    exposures_ms = np.full(int(exposed.frame.max()) + 1, 5.0)
    exposures_ms[exposed.frame[0]] = 10.0  # only the points of this pair are seen at different exposures
    changing = int(np.count_nonzero(np.diff(exposures_ms[exposed.frame].reshape(-1, 2))))
    with pytest.raises(NotObservableError, match="different exposures"):
        ospc.fit(exposed, exposures_ms, noise=NOISE, settings=DefaultSettings(min_points=changing + 1))
    with pytest.raises(ExposureError, match="does not show"):  # enough points, but the other exposures are wrong
        ospc.fit(exposed, exposures_ms, noise=NOISE, settings=DefaultSettings(min_points=changing))


@pytest.mark.parametrize(
    ("exposures_ms", "said"),
    [
        (np.ones((5, 2)), "shape"),
        (np.ones(3), "frame 79 has no exposure"),
        (np.zeros(80), "positive"),
        (np.full(80, np.inf), "positive"),
    ],
)
def test_exposures_that_do_not_fit_are_refused(exposures_ms, said):
    exposed, _ = made(Camera(GAMMA))
    with pytest.raises(SettingError, match=said):
        ospc.fit(exposed, exposures_ms)


@pytest.mark.parametrize(
    ("index", "wrong", "said"),
    [
        (0, np.full((30, 2), 0.5), "grey0 and grey1"),
        (1, np.full(29, 0.5), "grey0 and grey1"),
        (0, np.full(30, 128.0), "divide grey values"),
        (0, np.full(30, np.nan), "grey must be finite"),
        (2, np.zeros(30), "position0 and position1"),
        (3, np.full((30, 2), 320.0), "half diagonals"),
        (3, np.zeros((1, 30, 2)), "position0 and position1"),
        (4, np.zeros(7), "frame0 and frame1"),
        (5, np.full(30, -1), "frame numbers"),
        (4, np.full(30, 0.9), "whole numbers, not 0.9"),
        (5, np.nan, "whole numbers, not nan"),
    ],
)
def test_pairs_of_wrong_shapes_or_values_are_refused(index, wrong, said):
    given = [np.full(30, 0.5), np.full(30, 0.4), np.zeros((30, 2)), np.zeros((30, 2)), 0, 1]
    assert len(ospc.Observations.of_pairs(*given)) == 60
    given[index] = wrong
    with pytest.raises(SettingError, match=said):
        ospc.Observations.of_pairs(*given)


def test_whole_frame_numbers_may_be_floats():
    pairs = ospc.Observations.of_pairs(
        np.full(2, 0.5), np.full(2, 0.4), np.zeros((2, 2)), np.zeros((2, 2)), 2.0, [3.0, 4.0]
    )
    np.testing.assert_array_equal(pairs.frame, [2, 3, 2, 4])
    assert pairs.frame.dtype == np.int64


def test_frame_numbers_that_are_floats_are_refused_in_complete_observations():
    exposed, exposures_ms = made(Camera(GAMMA))
    with pytest.raises(SettingError, match="frame must have an integer type"):
        ospc.fit(replace(exposed, frame=exposed.frame + 0.5), exposures_ms)


def test_numbers_of_frames_and_points_may_be_of_any_integer_type():
    exposed, exposures_ms = made(Camera(GAMMA))
    plain = ospc.fit(exposed, exposures_ms)
    others = replace(exposed, frame=exposed.frame.astype(np.uint32), point=exposed.point - 1)
    np.testing.assert_array_equal(ospc.fit(others, exposures_ms).parameters, plain.parameters)


def test_points_of_pairs_belong_to_one_group():
    exposed, exposures_ms = made(Camera(GAMMA))
    for group in (np.arange(len(exposed)), exposed.frame):
        with pytest.raises(SettingError, match="need the same group"):
            ospc.fit(replace(exposed, group=group), exposures_ms)


@pytest.mark.parametrize("factor", [1 + 1e-12, 1.5, 1e-3])
def test_the_unit_of_the_exposures_does_not_change_the_stated_error(factor):
    """All ratios of a bracket are equal but for rounding, which must not divide them into small and large ones."""
    exposed, exposures_ms = made(Camera(GAMMA, bracketed=True))
    errors = [ospc.fit(exposed, exposures_ms * each).vignette_errors(SIZE).sigma_at_corner for each in (1, factor)]
    assert errors[1] == pytest.approx(errors[0], rel=1e-4)


def test_points_observed_once_are_refused():
    exposed, exposures_ms = made(Camera(GAMMA))
    with pytest.raises(SettingError, match="two or more observations"):
        ospc.fit(replace(exposed, point=np.arange(len(exposed))), exposures_ms)


def test_the_response_may_be_composed_of_other_functions(monkeypatch):
    monkeypatch.setitem(FUNCTIONS, "crowded", HatsCrowdedAtBlack())
    exposed, exposures_ms = made(Camera(GAMMA))
    settings = replace(DefaultSettings(), response_functions="crowded")
    found = ospc.fit(exposed, exposures_ms, noise=NOISE, settings=settings)
    assert found.response().model["functions"] == "crowded"
    knots = np.linspace(0, 1, 1 + settings.response_intervals) ** 2
    np.testing.assert_allclose(found.response_basis.knots, knots)
    assert response_shape_rmse(found.response(), GAMMA) < 0.01


def test_functions_that_do_not_exist_are_refused():
    with pytest.raises(SettingError, match="known: hats"):
        ResponseBasis(8, "splines")
