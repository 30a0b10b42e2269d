"""Pairs of frames whose exposures are wrong are left out, as long as most exposures are right."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ospc.estimation.effect_choice import fit_with_chosen_effects
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.fitted import Fitted
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.evaluation.metrics import log_ratio_error
from ospc.methods.fitting import calibrate_observations
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.settings.brightness import CONTRADICTING_PAIR_LOG
from synthetic_observations import ROUNDS, SIZE, Camera

GAMMA = Response.gamma(2.0, 2041)
PLAN = FitPlan(ResponseBasis(32), VignetteBasis(8), NoiseModel(1e-5, 0.0), ROUNDS)
GROUPS = 40


def recorded(
    share: float, log_error: float, seed: int = 1, points: int = 300
) -> tuple[ExposedObservations, set[int]]:
    """Return pairs, the second exposure of some of which is wrong by a random sign, and the numbers of these."""
    seen = Camera(GAMMA).pairs(seed, groups=GROUPS, points=points)
    random = np.random.default_rng(seed)
    wrong = random.permutation(GROUPS)[: round(GROUPS * share)]
    error = np.zeros(GROUPS)
    error[wrong] = log_error * random.choice([-1.0, 1.0], len(wrong))
    second = np.arange(len(seen)) % 2 == 1
    return replace(seen, log_exposure=seen.log_exposure + error[seen.group] * second), set(wrong.tolist())


@cache
def fitted(share: float, log_error: float, seed: int, /) -> Fitted:
    return fit_with_chosen_effects(recorded(share, log_error, seed)[0], PLAN)


def left_out(found: Fitted) -> set[int]:
    return set(range(GROUPS)) - set(found.observations.group.tolist())


@pytest.mark.parametrize("share", [0.03, 0.1, 0.2])
@pytest.mark.parametrize("log_error", [0.08, 0.4])
def test_they_are_left_out_and_the_response_is_that_of_the_others(share: float, log_error: float) -> None:
    found = fitted(share, log_error, 1)
    assert left_out(found) == recorded(share, log_error)[1]
    assert not found.fit.errors.gain_variances
    right = fitted(0.0, 0.0, 1)
    assert log_ratio_error(found.fit.response(), GAMMA) < 1.5 * log_ratio_error(right.fit.response(), GAMMA) + 3e-4


def test_they_remain_for_the_comparison_of_exposures() -> None:
    found = fitted(0.1, 0.4, 1)
    assert found.registered is not None
    assert set(found.registered.group.tolist()) == set(range(GROUPS))


@pytest.mark.parametrize("seed", range(4))
def test_none_is_left_out_if_all_are_right(seed: int) -> None:
    found = fitted(0.0, 0.0, seed)
    assert (left_out(found), found.registered) == (set(), None)


@pytest.mark.parametrize("metadata_error", [0.005, 0.03])
def test_none_is_left_out_if_all_are_inexact(metadata_error: float) -> None:
    """There are no right ones that it could contradict: latent gains describe them."""
    seen = Camera(GAMMA, metadata_error=metadata_error).pairs(5, groups=GROUPS, points=300)
    found = fit_with_chosen_effects(seen, PLAN)
    assert left_out(found) == set()
    assert found.fit.errors.gain_variances


def test_none_is_left_out_if_many_are_wrong() -> None:
    assert left_out(fitted(0.4, 0.4, 1)) == set()


def test_pairs_of_few_points_are_not_judged() -> None:
    observations, _ = recorded(0.1, 0.4, points=60)
    assert left_out(fit_with_chosen_effects(observations, PLAN)) == set()


def test_a_note_says_how_many_and_the_ratios_show_which() -> None:
    observations, wrong = recorded(0.1, 0.4)
    exposures_ms = np.full(observations.frame.max() + 1, np.nan)
    exposures_ms[observations.frame] = np.exp(observations.log_exposure)
    found = calibrate_observations(observations, exposures_ms, size=SIZE, noise=NoiseModel(1e-5, 0.0))
    assert any(f"not used: {len(wrong)} of {GROUPS} pairs" in note for note in found.notes)
    ratios = found.exposure_ratios
    assert np.count_nonzero(np.abs(ratios.log_residual) > CONTRADICTING_PAIR_LOG) == len(wrong)
