"""Advice names what is missing, stays long enough to be followed, and ends when both curves are known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.estimation.effects import Effects
from ospc.estimation.fitted import Fitted
from ospc.estimation.maximum_likelihood import fit_model
from ospc.estimation.model import Model
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.live.advice import Adviser
from ospc.live.capture import Bars
from ospc.live.knowledge import certainty, knowledge_of
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.preview import Preview
from ospc.methods.result import calibration_of
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.settings import DefaultSettings
from ospc.settings.live import GOAL, HOLD_S, PATIENCE_S
from synthetic_observations import SIZE, Camera

CAMERA = Camera(Response.gamma(2.2))


def fitted(observations):
    return fit_model(Model(ResponseBasis(16), VignetteBasis(16), Effects()), None, observations, rounds=3)


def state(seen, *, camera=CAMERA, pairs=40, seed=1):
    """Return the preview after recording only the points that ``seen`` selects."""
    everything = camera.pairs(seed, groups=pairs, points=400)
    observations = everything.of_points(np.logical_and.reduceat(seen(everything), everything.starts))
    if camera.log_ratio < 0.1:  # no exposure changes from pair to pair either
        first = np.repeat(observations.log_exposure[observations.starts], observations.counts)
        observations = replace(observations, log_exposure=observations.log_exposure - first)
    return Preview(SIZE, 255, pairs, observations, observations, fitted(observations))


def radius(observations):
    return np.hypot(*observations.position.T)


@cache
def no_dark():
    return state(lambda o: o.grey > 0.35, camera=replace(CAMERA, response=Response.gamma(1.0)))


@cache
def no_bright():
    return state(lambda o: o.grey < 0.6)


@cache
def no_outer():
    return state(lambda o: radius(o) < 0.3)


@cache
def no_exposures():
    return state(lambda o: o.grey < 0.95, camera=replace(CAMERA, log_ratio=0.06))


@cache
def everything():
    return state(lambda o: o.grey > 0.02, pairs=100)


STATES = (no_dark, no_bright, no_outer, no_exposures)


def advice(preview, goal=GOAL):
    return Adviser(goal).look(preview, 0.0)


def test_before_anything_is_known_it_says_how_to_begin():
    assert advice(None).kind == "begin"


def test_a_missing_bright_end_asks_for_something_almost_white():
    found = advice(no_bright())
    assert (found.kind, found.part, found.exposure) == ("bright", "response", 1)
    assert found.greys[1] > 0.7
    assert "almost white" in found.text


def test_a_missing_dark_end_asks_for_something_almost_black():
    found = advice(no_dark())
    assert (found.kind, found.part, found.exposure) == ("dark", "response", -1)
    assert found.greys[0] < 0.25
    assert "almost black" in found.text


def test_a_missing_corner_is_asked_for_with_an_arrow_that_leads_outwards():
    found = advice(no_outer())
    assert (found.kind, found.part) == ("move", "vignette")
    (x0, y0), (x1, y1) = found.arrow
    assert np.hypot(x1 - 0.5, y1 - 0.5) > np.hypot(x0 - 0.5, y0 - 0.5)
    assert found.radii[1] > 0.3
    # Points move right and up in the image when the camera turns left and down.
    words = {(True, False): "left and down", (False, False): "right and down"}
    turn = words.get((x1 > 0.5, y1 > 0.5)) or {True: "left and up", False: "right and up"}[x1 > 0.5]
    assert turn in found.text


def test_exposures_that_hardly_change_are_asked_to_change():
    for preview in (no_exposures(), replace(no_exposures(), fit=None)):
        found = advice(preview)
        assert (found.kind, found.part) == ("vary", "response")
        assert "exposure changes" in found.text


def test_without_matches_it_asks_for_slower_motion():
    adviser = Adviser()
    kinds = [adviser.look(replace(no_bright(), pairs=40 + 2 * i), 0.5 * i).kind for i in range(20)]
    assert kinds[0] == "bright"
    assert kinds[-1] == "slower"


def test_waiting_for_matches_takes_no_memory():
    adviser = Adviser()
    for i in range(50):
        adviser.look(no_bright(), 0.5 * i)
    assert len(adviser._found) == 1


@pytest.mark.parametrize("made", STATES)
def test_the_advice_has_the_largest_expected_gain(made):
    preview = made()
    knowledge, found = knowledge_of(preview), advice(preview)
    if found.greys is not None:
        wanted = np.mean(found.greys)
        other = 0.5
        gain = max(knowledge.gain_of_exposure(wanted, knowledge.grey_after(wanted, f), GOAL) for f in (1.5, 1 / 1.5))
        assert gain >= knowledge.gain_of_exposure(other, knowledge.grey_after(other, 1.5), GOAL)


@cache
def without_bright():
    return knowledge_of(no_bright())


@given(st.floats(0.05, 0.95), st.floats(0.05, 0.95))
def test_no_view_makes_anything_less_known(one, other):
    assert without_bright().gain_of_exposure(one, other, GOAL) >= 0
    assert without_bright().gain_of_motion(one, other, 0.4, GOAL) >= 0
    assert without_bright().gain_of_exposure(one, one, GOAL) == pytest.approx(0)


@settings(max_examples=3)
@given(st.lists(st.sampled_from(range(len(STATES))), min_size=8, max_size=20))
def test_an_instruction_stays_long_enough_to_be_followed(states):
    adviser, changes, before = Adviser(), [], None
    for number, which in enumerate(states):
        found = adviser.look(STATES[which](), 0.4 * number)
        if found.kind != before:
            changes.append(0.4 * number)
            before = found.kind
    assert all(later - earlier >= HOLD_S - 1e-9 for earlier, later in pairwise(changes))


def test_an_instruction_without_effect_is_replaced():
    adviser = Adviser()
    kinds = [adviser.look(no_bright(), 1.0 * second).kind for second in range(int(PATIENCE_S + 3))]
    assert kinds[0] == "bright"
    assert kinds[-1] != "bright"


def calibrated(pairs, *, seed=3):
    observations = CAMERA.pairs(seed, groups=pairs, points=400)
    fit = fitted(observations)
    noise = NoiseModel(1e-6, 1e-6)
    inputs = FitInputs(SIZE, 255, noise, observations, Fitted(fit, observations, None), False, pairs)
    return calibration_of(inputs, DefaultSettings())


def test_it_says_done_when_both_are_known_to_the_goal_and_not_before():
    known = calibrated(100)
    goal = 1.01 * max(certainty(known))
    found = Adviser(goal).look(no_bright(), 0.0, known)
    assert found.kind == "done"
    assert found.text.startswith("Done")
    assert Bars.of(no_bright(), found).certainty == 1.0
    assert Adviser(0.9 * goal).look(no_bright(), 0.0, known).kind != "done"
    few = replace(known, counts=known.counts | {"pairs": 10})
    assert Adviser(goal).look(no_bright(), 0.0, few).kind != "done"


def test_exposures_that_contradict_the_images_come_first():
    known = calibrated(30)
    stale = Verdict("not identifiable", "the exposures are stale", "switch gain control off")
    doubted = replace(known, verdicts=known.verdicts | {"exposures": stale})
    assert Adviser().look(no_bright(), 0.0, doubted).text == "switch gain control off; then start again"
    changed_before = replace(known, warnings=("the vignette changed at frame 7",))
    assert Adviser().look(no_bright(), 0.0, changed_before).kind == "bright"


def test_findings_of_the_full_estimate_only_are_shown_as_missing():
    known = calibrated(100)
    quick = advice(everything())
    adviser = Adviser(1.01 * max(quick.response_sigma, quick.vignette_sigma, *certainty(known)))
    found = adviser.look(everything(), 0.0, replace(known, vignette_sigma=known.vignette_sigma + 1))
    assert adviser.expects_end
    assert found.vignette_sigma > 1
    assert found.kind == "move"


@pytest.mark.parametrize("goal", [0.01, 0.2, 0.5])
@pytest.mark.parametrize("made", STATES)
def test_bars_are_shares(made, goal):
    preview = made()
    bars = vars(Bars.of(preview, advice(preview), goal))
    assert set(bars) == {"exposures", "greys", "radii", "certainty"}
    assert all(0 <= value <= 1 for value in bars.values())
    assert Bars.of(None, advice(None)) == Bars()
    assert Bars.of(no_outer(), advice(no_outer())).radii < 0.5
