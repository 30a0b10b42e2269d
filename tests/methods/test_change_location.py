"""The first frame of a change is found wherever the suspicion began."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.exposures.table import ExposureTable
from ospc.methods.change_hypotheses import first_changed_frame
from ospc.methods.prediction_errors import PairErrors
from ospc.settings import DefaultSettings
from ospc.simulation.responses import make_response
from synthetic_observations import POLYNOMIAL, SIZE, Camera

CAMERA = Camera(make_response("srgb"), POLYNOMIAL, log_ratio=0.2)
DARKER_CORNERS = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.8, 0.05, -0.2)))
ANOTHER_RESPONSE = replace(CAMERA, response=make_response("filmic"))
FRAMES, CHANGED_AT, AGE, EVERY = 160, 80, 3, 5
"""Number of frames, the first after the change, frames from the first to the second of a pair, and between pairs."""

FIRST_PAIR_AFTER = CHANGED_AT + AGE


@pytest.fixture(scope="module")
def fit():
    settings = DefaultSettings()
    basis = ResponseBasis(settings.response_intervals, settings.response_functions)
    plan = FitPlan(basis, VignetteBasis(settings.radial_terms), None, settings.rounds)
    return fit_with_chosen_vignette(CAMERA.pairs(10**6, groups=80, points=200), plan).fit


def errors_of(camera: Camera, number: int, fit, *, brighter: float = 0.0) -> PairErrors:
    """Return the errors of a pair whose second frame is brighter than its exposure predicts, by this much in ln."""
    seen = camera.pairs(number, groups=1)
    points = len(seen.starts)
    lower = np.tile([0.0, -brighter], points)
    frames = np.tile([number, number + AGE], points)
    return PairErrors.of(replace(seen, frame=frames, log_exposure=seen.log_exposure + lower), fit)


@pytest.mark.parametrize("suspected", [CHANGED_AT - 25, CHANGED_AT + 45])
@pytest.mark.parametrize("later", [DARKER_CORNERS, ANOTHER_RESPONSE], ids=["vignette", "response"])
def test_a_change_begins_with_the_first_pair_that_shows_it(fit, later, suspected):
    cameras = {number: CAMERA if number < CHANGED_AT else later for number in range(0, FRAMES, EVERY)}
    pairs = [errors_of(camera, number, fit) for number, camera in cameras.items()]
    assert first_changed_frame(pairs, fit, ExposureTable(), suspected) == FIRST_PAIR_AFTER


@pytest.mark.parametrize("suspected", [CHANGED_AT + 20, CHANGED_AT + 45])
def test_a_gain_is_missing_since_the_first_pair_that_follows_the_exposure_differently(fit, suspected):
    log_exposure = 0.3 * np.cos(np.arange(FRAMES + AGE))
    pairs = []
    for number in range(0, FRAMES, EVERY):
        step = log_exposure[number + AGE] - log_exposure[number]
        pairs.append(errors_of(CAMERA, number, fit, brighter=0.0 if number < CHANGED_AT else 0.5 * step))
    assert first_changed_frame(pairs, fit, ExposureTable.of(log_exposure), suspected) == FIRST_PAIR_AFTER


def test_outliers_that_the_change_explains_badly_do_not_count_as_unchanged(fit):
    brighter_corners = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.2, 0.05, -0.2)))
    pairs = []
    for number in range(0, FRAMES, EVERY):
        refocused = brighter_corners if CHANGED_AT + 10 < number < CHANGED_AT + 25 else DARKER_CORNERS
        pairs.append(errors_of(CAMERA if number < CHANGED_AT else refocused, number, fit))
    assert first_changed_frame(pairs, fit, ExposureTable(), CHANGED_AT + 45) == FIRST_PAIR_AFTER


def test_an_outlier_just_before_that_pair_is_the_first_changed_frame(fit):
    cameras = {number: CAMERA if number < CHANGED_AT else DARKER_CORNERS for number in range(0, FRAMES, EVERY)}
    pairs = [errors_of(camera, number, fit) for number, camera in cameras.items()]
    assert first_changed_frame(pairs, fit, ExposureTable(), CHANGED_AT) == CHANGED_AT


def test_a_change_is_not_moved_without_pairs_since_it(fit):
    pairs = [errors_of(CAMERA, number, fit) for number in range(0, FRAMES, EVERY)]
    assert first_changed_frame(pairs, fit, ExposureTable(), FRAMES + AGE) == FRAMES + AGE
