"""A change of the lag is detected in the latest frames and not confused with anything else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from filmed import LARGE, LARGEST, Film, jumping, observed, wandering

from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.lag_change import LagChange, detect_lag_change

FRAMES, SWITCH = 200, 120
CLOUD = -0.4 * np.exp(-(((np.arange(FRAMES) - 130) / 25) ** 2))
WANDERING, JUMPING = (Film(course(FRAMES, 5)) for course in (wandering, jumping))


def changes(film: Film) -> tuple[BrightnessChange, ...]:
    """Return the brightness changes of a film."""
    return observed(film)[0].changes


def stated(true: np.ndarray, before: int, after: int) -> np.ndarray:
    """Return exposures recorded with lag ``before`` until the switch, and ``after`` from then on."""
    number = np.arange(len(true))
    return true[np.clip(number - np.where(number < SWITCH, before, after), 0, len(true) - 1)]


def proven(seen: Sequence[BrightnessChange], log_exposure: np.ndarray, known: int) -> LagChange | None:
    """Return the change of the lag if it is proven."""
    change = detect_lag_change(seen, log_exposure, known)
    return change if change is not None and change.proven else None


@pytest.mark.parametrize(("before", "after"), [(0, 2), (0, -1), (2, 0), (1, 3)])
@pytest.mark.parametrize("film", [WANDERING, JUMPING], ids=["wandering", "jumping"])
def test_it_is_found_with_its_size_and_about_its_frame(film: Film, before: int, after: int) -> None:
    change = proven(changes(film), stated(film.log_exposure, before, after), before)
    assert change is not None
    assert change.later_frames == after - before
    assert SWITCH - 10 <= change.frame <= SWITCH + 15


@pytest.mark.parametrize("lag", [0, 2])
@pytest.mark.parametrize(
    "film",
    [
        Film(wandering(FRAMES, 6), noise=3.0, movers=5),
        Film(wandering(FRAMES, 7), metadata_error=0.01),
        Film(wandering(FRAMES, 8), hidden_log_gain=CLOUD),
        Film(jumping(FRAMES, 9), hidden_log_gain=np.where(np.arange(FRAMES) < SWITCH, 0.0, 0.3)),
        Film(np.zeros(FRAMES), hidden_log_gain=CLOUD),
    ],
)
def test_noise_clouds_and_lamps_are_none(film: Film, lag: int) -> None:
    assert proven(changes(film), stated(film.log_exposure, lag, lag), lag) is None


@pytest.mark.parametrize("jump", [0.3, 0.6, -0.6, 6.9])
@pytest.mark.parametrize("compared", [0, 3])
def test_a_jump_of_the_stated_exposures_is_none(jump: float, compared: int) -> None:
    """Almost any other lag explains the pair of frames at the jump; only a few pairs near it are compared."""
    number = np.arange(FRAMES)
    film = Film(0.4 * np.sin(number / 20), seed=3)
    near = [c for c in changes(film) if compared == 0 or not 0 <= c.frame0 - SWITCH - compared < 40]
    for at in (SWITCH - 1, SWITCH, SWITCH + 1):
        assert proven(near, film.log_exposure + np.where(number < at, 0.0, jump), 0) is None


def test_flicker_that_the_exposure_control_begins_to_follow_is_none() -> None:
    """The exposure was at its limit before, so the flicker did not change it."""
    frames, limited = 300, 130
    number = np.arange(frames)
    light = 0.046 * np.sin(2 * np.pi * 0.161 * number)
    course = np.zeros(frames)
    for i in range(limited, frames):
        course[i] = course[i - 1] - 0.29 * (light[i - 1] + course[i - 1])
    course += np.where(number < limited, 0.0, 0.016 * wandering(frames, 33))
    film = Film(course, hidden_log_gain=light, size=LARGE, movers=2, noise=2.34)
    assert proven(changes(film), course, 0) is None


@pytest.mark.parametrize(("gain", "cycles_per_frame"), [(0.3, 0.165), (0.6, 0.165), (0.6, 0.11)])
def test_flicker_that_the_exposure_control_always_follows_is_none(gain: float, cycles_per_frame: float) -> None:
    """Exposures recorded a frame earlier would explain nearly all of the brightness changes, flicker included."""
    frames = 550
    number = np.arange(frames)
    light = 0.08 * np.sin(2 * np.pi * cycles_per_frame * number)
    course, wanted = np.zeros(frames), 0.3 * wandering(frames, 33)
    for i in range(1, frames):
        course[i] = course[i - 1] - gain * (light[i - 1] + course[i - 1] - wanted[i])
    film = Film(course, hidden_log_gain=light, size=LARGE)
    assert proven(changes(film), course, 0) is None


@pytest.mark.parametrize("after", [1, 2])
def test_periodic_exposures_are_not_taken_for_flicker(after: int) -> None:
    film = Film(0.2 * np.sin(2 * np.pi * np.arange(FRAMES) / 8.7) + 0.02 * WANDERING.log_exposure)
    change = proven(changes(film), stated(film.log_exposure, 0, after), 0)
    assert change is not None
    assert change.later_frames == after


@pytest.mark.parametrize(("seed", "size"), [(5, 0.015), (6, 0.012)])
def test_a_change_to_earlier_exposures_needs_stronger_evidence(seed: int, size: float) -> None:
    film = Film(wandering(FRAMES, seed) * size, noise=2.0, size=LARGEST)
    assert proven(changes(film), stated(film.log_exposure, 0, 2), 0) is not None
    assert proven(changes(film), stated(film.log_exposure, 0, -2), 0) is None


def sparse_before(film: Film) -> list[BrightnessChange]:
    """Return the changes of a film, but only those in short bursts before the switch, as with trusted exposures."""
    return [change for change in changes(film) if change.frame0 >= SWITCH or change.frame0 % 24 < 8]


@pytest.mark.parametrize(("before", "after"), [(0, 2), (1, 0)])
def test_few_pairs_before_suffice_if_they_exclude_the_later_lag(before: int, after: int) -> None:
    change = proven(sparse_before(JUMPING), stated(JUMPING.log_exposure, before, after), before)
    assert change is not None
    assert change.later_frames == after - before


def test_few_pairs_before_that_fit_any_lag_leave_a_suspicion() -> None:
    film = Film(np.where(np.arange(FRAMES) < SWITCH - 5, 0.0, JUMPING.log_exposure))
    change = detect_lag_change(sparse_before(film), stated(film.log_exposure, 2, 2), 0)
    assert change is not None
    assert change.later_frames == 2
    assert not change.proven


def test_a_few_frames_prove_nothing() -> None:
    few = [change for change in changes(WANDERING) if change.frame0 >= FRAMES - 20]
    assert proven(few, stated(WANDERING.log_exposure, 0, 2), 0) is None


def test_a_lag_that_slow_light_can_explain_is_only_suspected() -> None:
    """Slowly changing exposures prove nothing if the light can change in the same way."""
    number = np.arange(FRAMES)
    course = 0.4 * np.sin(2 * np.pi * number / 60)
    # From the switch on, brightness follows the exposure of the next frame.
    gain = (number >= SWITCH) * np.diff(course, append=course[-1])
    film = Film(course, hidden_log_gain=gain, noise=0.5, size=LARGE)
    change = detect_lag_change(changes(film), course, 0)
    assert change is not None
    assert change.later_frames == 1
    assert not change.proven


def test_a_little_evidence_is_a_suspicion() -> None:
    """A suspicion makes the run compare more frames."""
    film, until = Film(WANDERING.log_exposure * 0.02, size=LARGE), SWITCH + 12
    little = [change for change in changes(film) if change.frame1 < until]
    change = detect_lag_change(little, stated(film.log_exposure, 0, 2)[:until], 0)
    assert change is not None
    assert change.later_frames == 2
    assert not change.proven
