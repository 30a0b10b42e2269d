"""Pairs of frames that were registered wrongly are left out; pairs that contradict the model are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ospc.estimation.effect_choice import fit_with_chosen_effects
from ospc.estimation.effects import Effects
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.estimation.wrong_pairs import registered_points
from ospc.evaluation.metrics import log_ratio_error, vignette_rmse
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from synthetic_observations import POLYNOMIAL, ROUNDS, SIZE, Camera

GAMMA = Response.gamma(2.0, 2041)
PLAN = FitPlan(ResponseBasis(32), VignetteBasis(8), NoiseModel(1e-5, 0.0), ROUNDS)


def facade(share: float, seed: int) -> tuple[ExposedObservations, np.ndarray]:
    """Return pairs of which a share compares each place with another one, and the numbers of these pairs."""
    seen = Camera(GAMMA).pairs(seed, groups=60)
    random = np.random.default_rng(seed)
    wrong = random.permutation(60)[: round(60 * share)]
    grey = seen.grey.copy()
    for pair in wrong:
        second = np.flatnonzero(seen.group == pair)[1::2]
        grey[second] = grey[random.permutation(second)]
    return replace(seen, grey=grey), wrong


def registered_pairs(observations: ExposedObservations) -> set[int]:
    plain = fit_with_chosen_vignette(observations, PLAN, Effects.none_of(observations))
    return set(observations.group[0::2][registered_points(plain)].tolist())


@pytest.mark.parametrize("share", [0.05, 0.25, 0.5])
def test_pairs_that_compare_other_places_are_left_out(share: float) -> None:
    observations, wrong = facade(share, seed=2)
    found = fit_with_chosen_effects(observations, PLAN)
    assert set(found.observations.group.tolist()) == set(range(60)) - set(wrong.tolist())
    assert log_ratio_error(found.fit.response(), GAMMA) < 0.002
    assert vignette_rmse(found.fit.vignette(SIZE), POLYNOMIAL, 1.0) < 0.004


@pytest.mark.parametrize("seed", range(4))
def test_all_pairs_of_a_good_recording_are_used(seed: int) -> None:
    assert len(registered_pairs(facade(0.0, seed)[0])) == 60


@pytest.mark.parametrize("exponent", [0.9, 1.15])
@pytest.mark.parametrize("offset", [0.0, 0.02])
@pytest.mark.parametrize("slope", [0.0, 0.15])
def test_frames_with_another_response_black_level_or_vignette_are_used(
    exponent: float, offset: float, slope: float
) -> None:
    """They contradict the model, and without them the calibration would look right."""
    seen = facade(0.0, seed=1)[0]
    changed = (seen.group % 5 == 0) & (np.arange(len(seen)) % 2 == 1)
    other = seen.grey**exponent * np.exp(slope * seen.position[:, 0]) + offset
    disturbed = replace(seen, grey=np.clip(np.where(changed, other, seen.grey), 0.0, 0.98))
    assert len(registered_pairs(disturbed)) == 60


@pytest.mark.parametrize("factor", [1 / 1000, 0.2, 3.0, 10.0, 1000.0])
def test_pairs_whose_points_agree_that_the_exposures_are_wrong_are_used(factor: float) -> None:
    """Only with them can the calibration show that the exposures are wrong."""
    seen = facade(0.0, seed=3)[0]
    second = np.arange(len(seen)) % 2 == 1
    wrong = second & (seen.group % 20 == 0)
    assert len(registered_pairs(replace(seen, log_exposure=seen.log_exposure + np.log(factor) * wrong))) == 60
