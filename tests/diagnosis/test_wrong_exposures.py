"""Single wrong exposures are ignored and named; real changes of exposure never are."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from filmed import LARGE, Film, fitted, found, observed, wandering

from ospc.calibrator import calibrate
from ospc.evaluation.metrics import log_ratio_error
from ospc.exposures.evidence import evidence_of_images
from ospc.exposures.verdicts import findings_from
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.recording import ArrayRecording
from ospc.settings import DefaultSettings

FRAMES = 80
GOOD = Film(wandering(FRAMES))
QUICK = replace(DefaultSettings(), points_per_pair=120, rounds=5, response_intervals=16)


def stated(film: Film, factors: dict[int, float]) -> np.ndarray:
    """Return ln of the recorded exposures of a film, some of them multiplied by a factor."""
    log_exposure = observed(film)[1].copy()
    for frame, factor in factors.items():
        log_exposure[frame] += np.log(factor)
    return log_exposure


@pytest.mark.parametrize("factors", [{30: 10.0}, {12: 0.1, 50: 2.5}, {20: 1000.0, 40: 0.001, 60: 0.4}])
@pytest.mark.parametrize("lag", [0, 2])
def test_they_are_ignored_and_named(factors: dict[int, float], lag: int) -> None:
    film = replace(GOOD, lag=lag)
    told = found(film, stated_log_exposure=stated(film, factors))
    assert told.evidence.wrong == tuple(factors)
    assert ", ".join(map(str, factors)) in told.notes[0]
    assert (told.corrected_frames, told.warnings, told.verdict.state) == (lag, (), "identifiable")
    # What the exposures were instead is only interpolated.
    assert told.brightness.unexplained_share < 0.1


@pytest.mark.parametrize("sign", [1, -1])
def test_those_that_differ_by_little_are_found_if_their_neighbours_hardly_differ(sign: int) -> None:
    wrong = {20: np.exp(0.15 * sign), 40: np.exp(-0.3 * sign), 60: np.exp(0.5 * sign)}
    film = Film(0.3 * wandering(FRAMES))
    assert found(film).evidence.wrong == ()
    assert found(film, stated_log_exposure=stated(film, wrong)).evidence.wrong == tuple(wrong)


def test_some_more_make_the_others_doubtful() -> None:
    some = dict.fromkeys(range(8, FRAMES, 15), 2.0)
    told = found(GOOD, stated_log_exposure=stated(GOOD, some))
    assert told.evidence.wrong == tuple(some)
    assert told.verdict.state == "marginal"
    assert f"{len(some)} of {FRAMES} exposures are wrong" in told.verdict.reason


@pytest.mark.parametrize("factor", [1000.0, 1e-3, 10.0])
@pytest.mark.parametrize("lag", [0, 2])
@pytest.mark.parametrize("missing", [range(0), range(39, 42), range(42, 60)])
def test_another_unit_from_some_frame_on_is_a_jump_and_no_lag(factor: float, lag: int, missing: range) -> None:
    film = replace(GOOD, lag=lag)
    history, log_exposure = observed(film)
    other_unit = log_exposure + np.where(np.arange(FRAMES) < 40, 0.0, np.log(factor))
    told = findings_from(evidence_of_images([c for c in history.changes if c.frame0 not in missing], other_unit))
    assert (told.lag.frames, told.corrected_frames) == (lag, lag)
    assert told.verdict.state == "marginal"
    assert re.search(r"jumps by a factor of [\d.]+ at frame (39|40|41|42)", told.verdict.reason)


@pytest.mark.parametrize("missing", [range(30, 50), range(30, 80)])
def test_another_unit_is_seen_in_grey_levels_if_no_frames_near_it_were_compared(missing: range) -> None:
    history, log_exposure = observed(GOOD)
    other_unit = log_exposure + np.where(np.arange(FRAMES) < 40, 0.0, np.log(1000))
    told = findings_from(evidence_of_images([c for c in history.changes if c.frame0 not in missing], other_unit))
    # At the end of a recording, there are no grey levels to compare with.
    assert ("at frame 40" in told.verdict.reason) == (missing.stop < FRAMES)


@pytest.mark.parametrize("gap", [6, 20])
@pytest.mark.parametrize("others_are_real", [False, True])
def test_a_step_that_the_light_compensates_is_doubted_unless_others_are_real(
    gap: int, *, others_are_real: bool
) -> None:
    steps = np.repeat([0.0, 1.8, 0.0, -1.8] if others_are_real else [0.0, 0.0, 0.0, -1.8], FRAMES // 4)
    light = np.where(np.arange(FRAMES) < 3 * FRAMES // 4, 0.0, 1.8)
    film = Film(0.1 * wandering(FRAMES) + steps, hidden_log_gain=light)
    history, log_exposure = observed(film)
    missing = range(3 * FRAMES // 4 - gap // 2 - 5, 3 * FRAMES // 4 + gap // 2 + 5)
    told = findings_from(evidence_of_images([c for c in history.changes if c.frame0 not in missing], log_exposure))
    assert ("jumps" in told.verdict.reason) == (gap < 20 or not others_are_real)


@pytest.mark.parametrize("lag", [0, 3])
@pytest.mark.parametrize("missing", [range(0), range(35, 42)])
def test_a_real_step_of_the_exposure_is_none(lag: int, missing: range) -> None:
    film = Film(0.3 * wandering(FRAMES) + np.where(np.arange(FRAMES) < 40, -0.9, 0.9), lag=lag)
    history, log_exposure = observed(film)
    told = findings_from(evidence_of_images([c for c in history.changes if c.frame0 not in missing], log_exposure))
    assert told.corrected_frames == lag
    assert told.verdict.state == "identifiable"


@pytest.mark.parametrize("lag", [0, 2, -2])
@pytest.mark.parametrize("is_shown", [False, True])
def test_a_step_that_no_consecutive_frames_show_is_real_if_the_shortest_pair_across_shows_it(
    lag: int, *, is_shown: bool
) -> None:
    history, log_exposure = observed(replace(GOOD, lag=lag))
    step = np.where(np.arange(FRAMES) < 40, 0.0, np.log(20))
    told = findings_from(
        evidence_of_images([c for c in history.changes if c.frame0 not in range(39, 42)], log_exposure + step)
    )
    assert "at frame 40" in told.verdict.reason
    # Beside the place, within the lag, exposures agree anyway; the long pair is wrong, and another one is imprecise.
    frames = np.array([[30, 33], [35, 45], [20, 55], [38, 43], [38 - lag, 39 - lag], [50, 52]])
    residual = np.array([0.001, 0.002 if is_shown else -np.log(20), -1.0 if is_shown else 0.0, -1.4, 0.0, 0.002])
    sigma = np.array([0.003, 0.003, 0.003, 0.3, 0.003, 0.003])
    ratios = ExposureRatios(frames, np.ones(6), np.exp(residual), np.array([400, 90, 90, 300, 300, 400]), sigma)
    assert ("jumps" in fitted(told, ratios=ratios).verdict.reason) is not is_shown
    assert bool(fitted(told, ratios=ratios).brightness.jumps) is not is_shown


@pytest.mark.parametrize("ratio", [2.0, 4.0])
@pytest.mark.parametrize("lag", [0, 3])
def test_real_changes_for_one_frame_are_not(ratio: float, lag: int) -> None:
    bracket = np.log(ratio) * (np.arange(FRAMES) % 5 == 2)
    flashes = np.log(ratio) * np.isin(np.arange(FRAMES), [20, 45])
    for extra in (bracket, flashes):
        film = Film(0.3 * wandering(FRAMES) + extra - np.log(ratio) / 2, lag=lag)
        assert found(film).evidence.wrong == ()


def test_of_many_none_can_be_told_from_the_right_ones() -> None:
    every_tenth = dict.fromkeys(range(5, FRAMES, 10), 10.0)
    told = found(GOOD, stated_log_exposure=stated(GOOD, every_tenth))
    assert told.evidence.wrong == ()
    assert told.verdict.state != "identifiable"


def test_those_of_frames_that_were_not_compared_are_left() -> None:
    history, log_exposure = observed(GOOD)
    without = [change for change in history.changes if change.frame0 != 30]
    wrong = log_exposure.copy()
    wrong[[30, 50]] += np.log(10)
    assert findings_from(evidence_of_images(without, wrong)).evidence.wrong == (50,)


def test_the_calibration_is_that_of_the_right_exposures() -> None:
    film = Film(wandering(FRAMES), size=LARGE)
    right = film.recording()
    wrong_ms = right.exposures_ms.copy()
    wrong_ms[[25, 45]] *= [10.0, 0.1]
    wrong = ArrayRecording([frame.image for frame in right], wrong_ms, np.arange(FRAMES) / 20)
    known, same = calibrate(wrong, QUICK), calibrate(right, QUICK)
    assert "frames 25, 45" in known.notes[0]
    assert {n: v.state for n, v in known.verdicts.items()} == {n: v.state for n, v in same.verdicts.items()}
    truth = Response.gamma(2.2)
    assert log_ratio_error(known.response, truth) < 1.2 * log_ratio_error(same.response, truth) + 5e-4
