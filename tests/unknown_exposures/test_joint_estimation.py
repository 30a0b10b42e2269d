"""Joint estimation: minimum of its objective, ambiguous up to an exponent, near the truth given one known point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import response_rmse, vignette_rmse
from ospc.photometry.vignette import PolynomialVignette
from ospc.settings.unknown_exposures import RESPONSE_SAMPLES
from ospc.simulation import SimulationSettings, frames, truth
from ospc.unknown_exposures.joint_estimation import JointEstimate, estimate_jointly
from ospc.unknown_exposures.response_model import learned_model
from ospc.unknown_exposures.tracking import GainRobustTracker, TrackObservations

SIZE = (640, 480)
V = np.array([-0.3, 0.05, -0.1])
C = np.array([0.05, 0.03, -0.01, 0.01])


def observations(points=300, count=12, noise=0.0, seed=2, c=C, v=V) -> TrackObservations:
    """Return observations of points that move through all frames, generated from the model."""
    random = np.random.default_rng(seed)
    model = learned_model()
    log_e = 0.5 * np.sin(np.arange(count)) + 0.1 * random.normal(size=count)
    point, frame = (a.ravel() for a in np.meshgrid(np.arange(points), np.arange(count), indexing="ij"))
    radius = np.clip(random.uniform(0, 1, points)[:, None] + np.linspace(-0.4, 0.4, count), 0, 1).ravel()
    light = np.exp(random.uniform(np.log(0.03), np.log(0.5), points))
    x = np.minimum(np.exp(log_e)[frame] * (1 + radius[:, None] ** [2, 4, 6] @ v) * light[point], 1)
    grey = np.interp(x, np.linspace(0, 1, RESPONSE_SAMPLES), model.curve(c)) + noise * random.normal(size=x.size)
    kept = (x < 0.95) & (grey > 0.01)
    return TrackObservations(
        SIZE, point[kept], frame[kept], grey[kept], radius[kept], np.ones(kept.sum()), np.arange(count)
    ).since(0)


def estimate_from(recording) -> JointEstimate:
    tracker = GainRobustTracker()
    for frame in recording:
        tracker.push(frame)
    return estimate_jointly(tracker.observations())


def test_with_one_known_point_everything_is_found():
    seen = observations(points=150, noise=0.002)
    model = learned_model()
    found = estimate_jointly(seen, iterations=200).aligned_to(model.response(C))
    assert response_rmse(found.response, model.response(C)) < 0.01
    assert vignette_rmse(found.vignette, PolynomialVignette(SIZE, tuple(V))) < 0.01
    assert found.response.inverse(0.5) == pytest.approx(model.response(C).inverse(0.5), abs=2e-3)


def test_no_other_solver_finds_a_smaller_cost():
    """A general solver for all parameters starts from the result of the alternation."""
    seen = observations(points=40, count=6, noise=0.004)
    model = learned_model()
    found = estimate_jointly(seen, iterations=300)
    k, m, n = len(C), seen.frames.size, int(seen.point.max()) + 1
    radial = seen.radius[:, None] ** [2, 4, 6]
    grid = np.linspace(0, 1, RESPONSE_SAMPLES)

    def residual(p: np.ndarray) -> np.ndarray:
        c, v, log_e, log_l = np.split(p, [k, k + 3, k + 3 + m])
        x = np.exp(log_e)[seen.frame] * np.maximum(1 + radial @ v, 0.05) * np.exp(log_l)[seen.point]
        return seen.grey - np.interp(x, grid, model.curve(c))

    start_l = np.array(
        [
            np.median(
                np.log(model.response(found.coefficients).inverse(seen.grey[seen.point == p]))
                - found.log_exposures[seen.frame[seen.point == p]]
                - np.log(1 + radial[seen.point == p] @ found.radial)
            )
            for p in range(n)
        ]
    )
    start = np.concatenate([found.coefficients, found.radial, found.log_exposures, start_l])
    best = least_squares(residual, start, loss="huber", f_scale=0.015, max_nfev=20)
    # SciPy's robust cost is half the sum of the loss that is averaged here
    assert found.cost <= 2 * best.cost / seen.grey.size * 1.02


@given(st.floats(0.5, 2.0))
@settings(max_examples=5)
def test_an_exponent_changes_response_vignette_and_exposures_together(exponent):
    found = estimate_jointly(observations(points=80), iterations=5)
    powered = replace(found, exponent=exponent)
    greys = np.linspace(0.2, 0.9, 10)
    np.testing.assert_allclose(powered.response.inverse(greys), found.response.inverse(greys) ** exponent, atol=5e-3)
    np.testing.assert_allclose(powered.exposures, found.exposures**exponent)
    radii = np.linspace(0, 1, 9)
    expected = PolynomialVignette(SIZE, tuple(found.radial)).profile(radii) ** exponent
    places = np.array(SIZE) / 2 * (1 + radii[:, None]) - 0.5
    found_there = powered.vignette.at(np.minimum(places, np.array(SIZE) - 1))
    np.testing.assert_allclose(found_there / found_there[0], expected, atol=5e-3)


def test_it_does_not_look_at_exposures():
    settings_ = SimulationSettings(frames=12, size=(160, 120), seed=5, scene_seed=0)
    shown = list(frames(settings_))
    hidden = [replace(f, exposure_ms=1.0) for f in shown]
    a, b = (estimate_from(fs) for fs in (shown, hidden))
    np.testing.assert_array_equal(a.coefficients, b.coefficients)
    np.testing.assert_array_equal(a.log_exposures, b.log_exposures)


def test_exposures_of_a_simulated_recording_are_recovered_up_to_an_exponent():
    settings_ = SimulationSettings(
        frames=40, size=(200, 150), seed=5, scene_seed=0, exposure="sweep", exposure_min_ms=5, exposure_max_ms=20
    )
    found = estimate_from(frames(settings_))
    true = np.log(truth(settings_).exposures_ms[found.frames])
    assert np.corrcoef(true, found.log_exposures)[0, 1] > 0.98


def test_tracks_follow_through_a_change_of_exposure():
    settings_ = SimulationSettings(
        frames=8, size=(320, 240), seed=1, scene_seed=0, exposure="cycle", exposures_ms=(5.0, 10.0), response="linear"
    )
    tracker = GainRobustTracker(every=1)
    gains = []
    for frame in frames(settings_):
        tracker.push(frame)
        gains.append(tracker.log_gain)
    np.testing.assert_allclose(np.abs(gains[1:]), np.log(2), atol=0.08)
    seen = tracker.observations()
    lives = np.bincount(seen.point)
    assert np.median(lives) >= 6


def test_little_is_refused():
    with pytest.raises(NotObservableError, match="observations"):
        estimate_jointly(observations(points=10, count=3))
    with pytest.raises(NotObservableError):
        estimate_from([])
