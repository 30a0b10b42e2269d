"""The lag estimate is right or reported as not determinable, but never wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filmed import Film, found, jumping, wandering

from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.lag_likelihood import fit_exposures

FRAMES = 80


@pytest.mark.parametrize(
    ("lag", "film"),
    [
        (2, {"log_exposure": jumping(FRAMES, 1), "gamma": 1.0, "noise": 4.0}),
        (-1, {"log_exposure": wandering(FRAMES, 2), "movers": 6, "speed_px": 4.0}),
        (3, {"log_exposure": wandering(FRAMES, 3, step=0.15), "metadata_error": 0.01}),
        (1, {"log_exposure": 0.4 * np.sin(np.arange(FRAMES) / 3), "speed_px": 0.0}),
    ],
)
def test_it_is_found_in_spite_of_noise_motion_and_inexact_metadata(lag: int, film: dict) -> None:
    assert found(Film(lag=lag, **film)).lag.frames == lag


def test_a_cycle_leaves_lags_that_differ_by_whole_cycles() -> None:
    exposures = found(Film(log_exposure=np.log([1.0, 2.0, 4.0])[np.arange(FRAMES) % 3] - 1, lag=1))
    assert exposures.lag.frames is None
    assert set(exposures.lag.candidates) == {-5, -2, 1, 4}
    # All candidates lead to the same correction.
    assert exposures.lag.certain_frames(exposures.evidence.recorded.cycle_frames) == 1
    assert exposures.lag.certain_frames(None) is None


def test_a_long_cycle_leaves_one_usual_lag() -> None:
    cycle = np.log([1, 3, 2, 5, 2.5, 4, 1.5, 6])
    exposures = found(Film(log_exposure=cycle[np.arange(FRAMES) % 8] - 1, lag=-2))
    assert exposures.evidence.recorded.cycle_frames == 8
    assert exposures.lag.frames == -2


def test_a_steady_change_shows_no_lag() -> None:
    exposures = found(Film(log_exposure=np.linspace(-0.6, 0.6, FRAMES), lag=2))
    assert exposures.lag.frames is None
    assert exposures.lag.certain_frames(exposures.evidence.recorded.cycle_frames) is None


@pytest.mark.parametrize(("lag", "allowed"), [(0, {0}), (1, {1, None}), (3, {3, None})])
def test_brackets_around_a_wandering_exposure_do_not_follow_a_weak_flicker_of_their_period(
    lag: int, allowed: set[int | None]
) -> None:
    number = np.arange(FRAMES)
    bracket = np.array([-0.5, 0.0, 0.5])[number % 3]
    light = 0.04 * np.cos(2 * np.pi * number / 3 + 0.4)
    exposures = found(Film(log_exposure=wandering(FRAMES, 5) + bracket, hidden_log_gain=light, lag=lag))
    assert exposures.lag.frames in allowed


@pytest.mark.parametrize(("gain", "lag"), [(0.2, 2), (0.5, -1)])
def test_exposures_that_chase_a_swinging_light_are_never_given_a_wrong_lag(gain: float, lag: int) -> None:
    frames = 120
    light = 0.08 * np.sin(2 * np.pi * np.arange(frames) / 12.4)
    exposure = np.zeros(frames)
    for i in range(1, frames):
        exposure[i] = exposure[i - 1] - gain * (exposure[i - 1] + light[i - 1])
    exposures = found(Film(log_exposure=exposure, hidden_log_gain=light, lag=lag))
    assert exposures.lag.frames in (None, lag)


def simulated_observations(change: np.ndarray, scatter: float, rng: np.random.Generator) -> BrightnessSeries:
    """Return brightness changes in one grey bin, with exposures that are known inexactly."""
    pairs = len(change)
    error = rng.normal(0, scatter, pairs + 1)
    seen = 0.5 * (change + np.diff(error)) + rng.normal(0, 0.002, pairs)
    return BrightnessSeries(np.arange(pairs), seen[:, None], np.full((pairs, 1), 1000.0), np.zeros((pairs, 1, 2)))


def test_whitening_undoes_the_correlation_of_single_errors() -> None:
    rng = np.random.default_rng(0)
    seen = simulated_observations(np.zeros(4000), 0.02, rng)
    inexact = BrightnessSeries(
        seen.frame, seen.log_ratio, seen.weight, seen.vignette_terms, exposure_error=0.5 * 0.02 / 0.002
    )
    before, after = seen.log_ratio[:, 0], inexact.whitened(seen.log_ratio)[0][:, 0]
    assert np.corrcoef(before[1:], before[:-1])[0, 1] < -0.4
    assert abs(np.corrcoef(after[1:], after[:-1])[0, 1]) < 0.05


def test_the_slope_is_that_of_the_response() -> None:
    change = np.diff(wandering(300, 4))
    (fit,) = fit_exposures(simulated_observations(change, 0.0, np.random.default_rng(1)), change[None])
    assert fit.slopes[0] == pytest.approx(0.5, rel=0.02)
    assert fit.scale == pytest.approx(0.002, rel=0.25)


@pytest.mark.parametrize("scatter", [0.0, 2.0])
def test_fits_made_together_are_those_made_one_by_one(scatter: float) -> None:
    exposure = wandering(80, 4)
    changes = np.stack([np.diff(exposure)[lag : 75 + lag] for lag in range(4)] + [np.zeros(75)])
    seen = replace(simulated_observations(changes[1], 0.01, np.random.default_rng(2)), exposure_error=scatter)
    light = np.cos(np.arange(75.0))[:, None]
    for fit, change in zip(fit_exposures(seen, changes, light), changes, strict=True):
        (alone,) = fit_exposures(seen, change[None], light)
        np.testing.assert_allclose(fit.log_likelihood, alone.log_likelihood, atol=1e-9)
        np.testing.assert_allclose(fit.slopes, alone.slopes, atol=1e-9)
        np.testing.assert_allclose(fit.explained, alone.explained, atol=1e-9)
