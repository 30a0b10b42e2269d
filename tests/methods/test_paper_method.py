"""The paper's method on simulated recordings, with windows small enough to fill several times."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from recorded_in_memory import recorded

from ospc.calibrator import OnlineCalibrator
from ospc.correspondence.features import Features
from ospc.evaluation.metrics import response_shape_rmse, vignette_rmse
from ospc.methods.paper import Correspondences, PaperMethod
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import Frame
from ospc.settings import PaperSettings
from stated_exposures import StatedExposures

SMALL = replace(
    PaperSettings(),
    max_features=1200,
    response_window=35,
    response_max_radial_displacement=0.02,
    vignette_window=35,
    vignette_offset=10,
    vignette_min_radial_displacement=0.08,
)
QUICK = replace(SMALL, features="orb", max_features=600, response_window=20, vignette_window=30, min_samples=40)


@pytest.fixture(scope="module")
def run(walk):
    """Return the calibration from all 105 frames, and the progress after each."""
    calibrator, progress = OnlineCalibrator(SMALL), []
    for frame in walk.frames:
        assert calibrator.push(frame)
        progress.append(calibrator.status.progress)
    return calibrator.calibration(), progress


@pytest.fixture(scope="module")
def quick(walk, calibrated):
    return calibrated(walk.frames[:45], QUICK)


def as_text(calibration):
    return json.dumps(calibration.as_dict(), sort_keys=True)


def test_response_and_vignette_are_found(run, walk):
    result, _ = run
    assert result.complete
    assert result.converged
    assert response_shape_rmse(result.response, walk.truth.response) < 0.04
    assert vignette_rmse(result.vignette, walk.truth.vignette) < 0.1
    assert isinstance(result.vignette, PolynomialVignette)
    assert result.response.model["name"] == "polynomial"
    c = result.response.model["coefficients"]
    assert len(c) == 3
    assert c[0] == pytest.approx(0, abs=1e-9)
    assert sum(c) == pytest.approx(1, abs=1e-9)


def test_every_window_made_an_estimate(run):
    result, _ = run
    assert result.verdicts["response"].state == "identifiable"
    assert result.verdicts["response"].reason.startswith("3 windows")
    assert result.verdicts["vignette"].state == "identifiable"
    assert "windows of frames gave accepted estimates" in result.verdicts["vignette"].reason


def test_estimates_are_repeated_and_their_spread_is_stated(run):
    result, progress = run
    assert result.response.inverse_sigma.shape == (256,)
    assert 0 < result.response.inverse_sigma.max() < 0.1
    # Black is fixed, and all levels are relative to the middle one.
    assert result.response.inverse_sigma[[0, 127, 128]] == pytest.approx(0, abs=1e-3)
    assert result.vignette_sigma.shape == PROFILE_RADII.shape
    assert 0 < result.vignette_sigma[-1] < 0.3
    assert result.covariance["response"]["parameters"] == ["c0", "c1", "c2"]
    assert result.covariance["vignette"]["parameters"] == ["v1", "v2", "v3"]
    assert np.shape(result.covariance["vignette"]["matrix"]) == (3, 3)
    # A single estimate has no known spread; the second window ends 35 frames later.
    assert progress[60].response_sigma is None
    assert progress[100].response_sigma == pytest.approx(progress[101].response_sigma)
    assert progress[-1].response_sigma == pytest.approx(result.response.inverse_sigma.max())
    assert progress[-1].vignette_sigma == pytest.approx(result.vignette_sigma[-1])


def test_progress_only_grows(run):
    result, progress = run
    for before, after in pairwise(progress):
        assert after.pairs >= before.pairs
        assert after.samples >= before.samples
    assert (progress[-1].pairs, progress[-1].samples) == (result.counts["pairs"], result.counts["samples"])


def test_exposures_are_predicted(run):
    result, _ = run
    ratios = result.exposure_ratios
    assert np.median(np.abs(ratios.log_residual)) < SMALL.acceptance_tolerance
    # The ratios of an accepted vignette are those of its pairs, ``vignette_offset`` frames apart.
    np.testing.assert_array_equal(np.diff(ratios.frames, axis=1), SMALL.vignette_offset)


def test_the_result_names_its_settings(run):
    result, _ = run
    assert result.settings["preset"] == "paper"
    assert result.settings["response_window"] == 35


def test_calibrating_in_between_does_not_change_the_result(walk, calibrated, quick):
    asked = calibrated(walk.frames[:45], QUICK, ask_after=(1, 19, 20, 21, 44))
    assert as_text(asked) == as_text(quick)
    assert quick.response is not None


def test_a_factor_on_all_exposures_changes_nothing(walk, calibrated, quick):
    doubled = calibrated([replace(f, exposure_ms=2 * f.exposure_ms) for f in walk.frames[:45]], QUICK)
    # Equal up to the rounding of ln e.
    np.testing.assert_allclose(doubled.response.inverse_table, quick.response.inverse_table, atol=1e-9)
    assert (doubled.vignette is None) == (quick.vignette is None)
    np.testing.assert_array_equal(doubled.exposure_ratios.frames, quick.exposure_ratios.frames)
    np.testing.assert_allclose(doubled.exposure_ratios.metadata, quick.exposure_ratios.metadata, rtol=1e-12)
    np.testing.assert_allclose(doubled.exposure_ratios.estimated, quick.exposure_ratios.estimated, rtol=1e-6)
    assert doubled.counts == quick.counts


def test_an_open_window_counts_only_without_a_full_one(walk, calibrated):
    alone = calibrated(walk.frames[:40], replace(QUICK, response_window=1000, vignette_window=1000))
    assert alone.response is not None
    assert alone.verdicts["response"].state == "marginal"
    assert alone.verdicts["response"].reason == "a single window of frames gave an estimate"
    assert "record longer" in alone.advice
    assert alone.response.inverse_sigma is None
    assert not alone.converged
    # The next frames change nothing until they fill a window of their own.
    full, more = (calibrated(walk.frames[:n], QUICK) for n in (20, 39))
    np.testing.assert_array_equal(full.response.inverse_table, more.response.inverse_table)


def test_a_constant_exposure_gives_no_calibration(calibrated):
    result = calibrated(recorded(frames=30, exposure="constant", size=(160, 120)).frames, QUICK)
    assert result.response is None
    assert result.vignette is None
    assert result.verdicts["response"].state == "not identifiable"
    assert "the exposure hardly changes (10 ms)" in result.verdicts["response"].reason
    assert result.verdicts["vignette"].reason == "without a response there is no irradiance to compare"
    assert "auto exposure" in result.advice[0]


def test_a_static_camera_gives_no_vignette(calibrated):
    made = recorded(
        frames=40, size=(240, 180), motion="static", exposure="sweep", exposure_min_ms=5.0, exposure_max_ms=20.0
    )
    result = calibrated(made.frames, QUICK)
    assert result.response is not None
    assert result.vignette is None
    assert result.verdicts["vignette"].state == "not identifiable"
    assert "move radially" in result.verdicts["vignette"].reason
    assert any("pan" in line for line in result.advice)


def test_estimates_that_do_not_predict_the_exposures_are_not_accepted(walk, calibrated):
    strict = calibrated(walk.frames[:45], replace(QUICK, acceptance_tolerance=1e-6))
    assert strict.response is None
    assert "none of 2 estimates predicted the exposure ratios" in strict.verdicts["response"].reason
    assert "check that exposures belong" in strict.verdicts["response"].remedy


# Exact matches: everything after the matching must be exact as well.


class PerfectMatcher:
    """Noise-free matches of a camera with g = c₁M + c₂M² and a polynomial vignette."""

    def __init__(self, c1, v, size=(640, 480), astray=0.0):
        self.c1, self.c2 = c1, 1 - c1
        self.vignette, self.size, self.astray = PolynomialVignette(size, v), size, astray
        self.exposures_ms = {}

    def features(self, frame):
        self.exposures_ms[frame.index] = frame.exposure_ms
        return Features(frame.index, np.empty((0, 2)), np.empty(0), np.empty((0, 1), np.uint8))

    def correspondences(self, left, right, size):
        random = np.random.default_rng((left.frame, right.frame))
        centre = (np.array(size) - 1) / 2
        points0, points1 = random.uniform(0, 1, (2, 60, 2)) * 2 * centre
        # A third of the points keep their radius exactly, as do those that would change it little.
        change = [np.linalg.norm(p - centre, axis=1) / np.linalg.norm(centre) for p in (points0, points1)]
        keeps = (np.arange(60) < 20) | (np.abs(change[0] - change[1]) < 0.02)
        points1[keeps] = 2 * centre - points0[keeps]
        exposures_ms = [self.exposures_ms[features.frame] for features in (left, right)]
        light = random.uniform(0.05, 0.9, 60) / max(exposures_ms)
        grey = [
            self.grey(exposure_ms * light * self.vignette.at(places))
            for exposure_ms, places in zip(exposures_ms, (points0, points1), strict=True)
        ]
        astray = random.random(60) < self.astray
        grey[1] = np.where(astray, random.uniform(0.1, 0.9, 60), grey[1])
        return Correspondences((left.frame, right.frame), size, points0, points1, *grey)

    def grey(self, irradiance):
        return 2 * irradiance / (self.c1 + np.sqrt(self.c1**2 + 4 * self.c2 * irradiance))


V = (-0.3, 0.05, -0.15)
HALF = replace(PaperSettings(), response_window=100, vignette_window=200)


def after_matching(matcher, settings=None, frames=220, lag=0):
    """Run the method on perfect matches; exposures lag by ``lag`` frames until corrected at the last frame."""
    settings = settings or HALF
    method, known = PaperMethod(settings, matcher.size, 255, matcher), StatedExposures()
    image = np.zeros((1, 1), np.uint8)
    course = 10.0 * np.exp(0.5 * np.sin(np.arange(frames) / 9) + 0.05 * np.sin(np.arange(frames) * 1.7))
    for index in range(frames):
        known.add(index, course[max(index - lag, 0)])
        if index == frames - 1:
            for earlier in range(frames):
                known.add(earlier, course[earlier])
        method.push(Frame.of_array(image, course[index], index=index), None, known)
    return method.calibration(known)


@pytest.mark.parametrize(
    ("c1", "positivity", "solver"),
    [
        (0.3, "never", "l2"),
        (0.3, "never", "l1"),
        (0.3, "never", "m-estimator"),
        (0.3, "always", "l2"),
        (1.4, "when needed", "l2"),
        (1.4, "never", "m-estimator"),
    ],
)
def test_perfect_matches_give_the_truth(c1, positivity, solver):
    settings = replace(HALF, vignette_solver=solver, response_positivity=positivity)
    result = after_matching(PerfectMatcher(c1, V), settings)
    np.testing.assert_allclose(result.response.model["coefficients"], [0, c1, 1 - c1], atol=1e-6)
    profiles = [v.profile(PROFILE_RADII) for v in (result.vignette, PolynomialVignette((640, 480), V))]
    # The response is piecewise linear between the 256 levels of its table.
    np.testing.assert_allclose(*profiles, atol=1e-3)
    np.testing.assert_allclose(result.exposure_ratios.estimated, result.exposure_ratios.metadata, rtol=1e-3)
    assert result.verdicts["response"].reason.startswith("2 windows")
    assert result.verdicts["vignette"].state == "marginal"


def test_coefficients_that_may_not_be_negative_are_not():
    """Among the quadratics with c ≥ 0, the straight line is nearest to one with c₂ < 0."""
    result = after_matching(PerfectMatcher(1.4, V), replace(HALF, response_positivity="always"))
    np.testing.assert_allclose(result.response.model["coefficients"], [0, 1, 0], atol=1e-6)


def test_exposures_corrected_before_a_window_is_closed_count_for_all_of_it():
    long = replace(PaperSettings(), response_window=1000, vignette_window=1000)
    corrected, known_before = (after_matching(PerfectMatcher(0.3, V), long, frames=300, lag=lag) for lag in (2, 0))
    # The lag changes which frames are paired, but no pair is solved with a wrong exposure ratio.
    for result in (corrected, known_before):
        np.testing.assert_allclose(result.response.model["coefficients"], [0, 0.3, 0.7], atol=1e-6)
        np.testing.assert_allclose(result.exposure_ratios.estimated, result.exposure_ratios.metadata, rtol=1e-3)


def test_the_m_estimator_tolerates_wrong_matches_better_than_least_squares():
    error = {}
    for solver in ("l2", "m-estimator"):
        settings = replace(HALF, vignette_solver=solver, acceptance_tolerance=5.0)
        result = after_matching(PerfectMatcher(0.3, V, astray=0.05), settings)
        error[solver] = np.inf if result.vignette is None else abs(result.vignette.profile(1.0) - 1 - sum(V))
    assert error["m-estimator"] < error["l2"]
