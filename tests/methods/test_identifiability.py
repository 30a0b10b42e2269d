"""Reasons and remedies of verdicts: they name the cause, and never ask for what a recording already had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.estimation.effects import Effects
from ospc.methods.corrections import notes_of
from ospc.methods.identifiability import response_verdict, response_verdict_of_fit, vignette_verdict
from ospc.methods.result import calibration_of
from ospc.photometry.verdict import EffectEstimate
from ospc.settings import DefaultSettings
from summaries import CAMERA, inputs_of

INPUTS = inputs_of(CAMERA, 0)
FIT = INPUTS.fit
UNCERTAIN = replace(FIT, covariance=1e4 * FIT.covariance)
TONE = EffectEstimate("local tone mapping", -0.1, 0.01, contradicts=True)
GLARE = EffectEstimate("veiling glare", 0.02, 0.001, corrected=True)


def with_fit(fit, observations=INPUTS.observations):
    return replace(INPUTS, fitted=replace(INPUTS.fitted, fit=fit, observations=observations))


def response(*, times, unexplained=0.0, contradictions=()):
    return response_verdict_of_fit(UNCERTAIN, (1.0, times), unexplained, contradictions)


def vignette(*, radial_motion, stationary=False, contradictions=()):
    return vignette_verdict(
        UNCERTAIN, radial_motion, stationary, 0.0, size=INPUTS.size, contradictions=contradictions
    )


@pytest.mark.parametrize("covariance", [1.0, 1e4])
def test_a_contradiction_is_the_reason_and_has_the_remedy_of_every_curve(covariance):
    fit = replace(FIT, covariance=covariance * FIT.covariance, effect_estimates=(TONE,))
    found = calibration_of(with_fit(fit), DefaultSettings())
    (warning,) = found.warnings
    for verdict in (found.verdicts["response"], found.verdicts["vignette"]):
        assert verdict.state == ("marginal" if covariance == 1 else "not identifiable")
        assert verdict.reason.endswith(f", but {warning}")
        assert verdict.remedy.startswith("switch off local contrast")
    assert found.advice[0] == found.verdicts["response"].remedy
    assert not any("sweep the exposure" in text or "pan and tilt" in text for text in found.advice)


@pytest.mark.parametrize(("log_v", "state"), [(-0.5, "not identifiable"), (-1.5, "marginal")])
def test_an_uncertain_corner_alone_leaves_a_vignette_marginal_if_the_corner_is_dark(log_v, state):
    fit = inputs_of(replace(CAMERA, vignette=log_polynomial(INPUTS.size, (log_v,))), 0).fit
    last = np.zeros(len(fit.parameters))
    last[fit.vignette_part.start + 13 : fit.vignette_part.start + 16] = 1.0  # the knots from a radius of 0.99
    sigma = fit.vignette_basis.jacobian(fit.vignette_parameters, np.array([[0.8, 0.6]]))[0, 13:16].sum()
    fit = replace(fit, covariance=fit.covariance + np.outer(last, last) * (0.3 / sigma) ** 2)
    verdict = vignette_verdict(fit, 0.3, False, 0.0, size=INPUTS.size)
    assert "±30% (1σ)," in verdict.reason
    assert verdict.state == state


def test_a_contradiction_is_not_why_a_stationary_camera_shows_no_vignette():
    verdict = vignette(radial_motion=0.0, stationary=True, contradictions=(("the response changes", "fix it"),))
    assert verdict.reason.startswith("the camera is stationary")
    assert verdict.remedy.startswith("pan and tilt")


@pytest.mark.parametrize(("times", "asks"), [(3.0, True), (7.9, True), (8.0, False), (100.0, False)])
def test_wider_exposures_are_only_asked_for_if_they_were_narrower(times, asks):
    verdict = response(times=times)
    assert verdict.state == "not identifiable"
    assert ("let the exposure change by a factor of 8 or more" in verdict.remedy) is asks
    assert verdict.remedy


@pytest.mark.parametrize(("low_ms", "high_ms"), [(3.0, 12.0), (2.0, 30.0)])
def test_a_third_exposure_is_asked_for_if_there_are_only_two(low_ms, high_ms):
    pairs = INPUTS.observations
    bright = np.arange(len(pairs)) % 2 == 1
    alternating = replace(pairs, log_exposure=np.where(bright, np.log(high_ms), np.log(low_ms)))
    remedies = [
        response_verdict(DefaultSettings(), UNCERTAIN, observations, 0.0).remedy
        for observations in (alternating, pairs)
    ]
    assert [remedy.startswith("use three or more different exposures") for remedy in remedies] == [True, False]


@pytest.mark.parametrize(("cycles", "asks"), [(0.25, True), (1, False)])
def test_exposures_that_only_rise_are_to_rise_and_fall(cycles, asks):
    pairs = INPUTS.observations
    course = 2 * np.pi * cycles * pairs.frame / pairs.frame.max()
    changing = replace(pairs, log_exposure=np.log(10) + np.sin(course))
    remedy = response_verdict(DefaultSettings(), UNCERTAIN, changing, 0.0).remedy
    assert remedy.startswith("raise and lower the exposure") is asks


@pytest.mark.parametrize(
    ("value", "corrected", "asks"), [(0.03, False, True), (0.01, False, False), (0.03, True, False)]
)
def test_scattered_light_that_may_be_there_is_named_as_the_limit(value, corrected, asks):
    glare = EffectEstimate("veiling glare", value, 0.01, corrected=corrected)
    fit = replace(UNCERTAIN, effect_estimates=(glare,))
    remedy = response_verdict_of_fit(fit, (1.0, 10.0), 0.0).remedy
    assert ("veiling glare (3.0% ± 1.0%)" in remedy) is asks
    assert ("clean the lens" in remedy) is asks
    assert "sweep the exposure" in response_verdict_of_fit(fit, (1.0, 3.0), 0.0).remedy


@pytest.mark.parametrize(("radial_motion", "asks"), [(0.1, True), (0.194, True), (0.197, False), (0.3, False)])
def test_more_motion_is_only_asked_for_if_there_was_less(radial_motion, asks):
    verdict = vignette(radial_motion=radial_motion)
    assert verdict.state == "not identifiable"
    assert ("by a fifth of the half diagonal or more" in verdict.remedy) is asks
    assert verdict.remedy


def test_missing_changes_of_exposure_are_the_reason_however_uncertain_the_response():
    verdict = response(times=3.0, unexplained=0.2)
    assert verdict.state == "not identifiable"
    assert verdict.reason.endswith("but 20% of a typical change of exposure does not show in the images")
    assert verdict.remedy.startswith("check that each exposure")
    assert "light that does not move with the camera" in verdict.remedy
    both = response(times=3.0, unexplained=0.2, contradictions=(("the response changes", "fix it"),))
    assert (both.reason, both.remedy) == (f"{verdict.reason}; the response changes", "fix it")


def test_unsteady_light_is_accounted_for_and_its_remedy_asks_for_no_wider_exposures():
    unsteady = replace(UNCERTAIN, errors=replace(FIT.errors, gain_variances=(1e-4,)))
    remedy = response_verdict_of_fit(unsteady, (1.0, 100.0), 0.0).remedy
    assert "steadier light with a fixed white balance" in remedy
    assert "different exposures" not in remedy
    nearly_steady = replace(UNCERTAIN, errors=replace(FIT.errors, gain_variances=(1e-6,)))
    assert "steadier light" not in response_verdict_of_fit(nearly_steady, (1.0, 100.0), 0.0).remedy
    light = EffectEstimate("unsteady light", 0.02, 0.001, corrected=True)
    (note,) = notes_of(replace(FIT, effect_estimates=(light,)))
    assert note.endswith("by 2% between the frames of a pair; this was accounted for")
    assert not notes_of(replace(FIT, effect_estimates=(replace(light, value=0.0001),)))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("gain step 3 of 15", -0.007, "images with exposures above 8 ms are 0.7% ± 0.1% darker than"),
        ("gain step 3 of 15", 0.02, "images with exposures above 8 ms are 2.0% ± 0.1% brighter than"),
        ("stray light at the corners", 0.01, "is 1.00% ± 0.10% of white stronger at the corners at 4 ms"),
        ("stray light sideways", -0.01, "is 1.00% ± 0.10% of white weaker per half diagonal to the right at 4 ms"),
        ("dark signal at the top left", 0.003, "0.30% ± 0.10% of white higher at the top left"),
        ("glare in the centre", 0.02, "is 2.0% ± 0.1% of the mean irradiance of each frame stronger in the centre"),
        ("dark signal vertically", -0.003, "0.30% ± 0.10% of white lower per half diagonal downwards"),
        ("drifting light", -0.1, "the light fell by 10.0% ±"),
    ],
)
def test_a_note_states_size_and_place_of_what_was_corrected(name, value, words):
    effects = Effects(log_typical_exposure=np.log(4.0), step_exposures=(0.5, 1.0, 2.0))
    found = EffectEstimate(name, value, 0.001, corrected=True)
    (note,) = notes_of(replace(FIT, effects=effects, effect_estimates=(found,)))
    assert words in note
    assert note.endswith("this was corrected")


def test_a_note_says_that_nominal_exposures_were_replaced():
    (note,) = notes_of(replace(FIT, effect_estimates=(EffectEstimate("nominal exposures", 1.0, 0.01, True),)))
    assert "1/60 s for 1/64 s" in note


def test_a_fit_to_exposures_that_the_images_contradict_states_no_effects():
    """A contradiction of such a fit would be an effect of the wrong exposures."""
    fit = replace(FIT, effect_estimates=(TONE, GLARE))
    observations = INPUTS.observations
    inverse = replace(observations, log_exposure=-observations.log_exposure)
    wrong, right = (calibration_of(with_fit(fit, o), DefaultSettings()) for o in (inverse, observations))
    assert "does not show in the images" in wrong.verdicts["response"].reason
    assert (wrong.effects, wrong.warnings, wrong.notes) == ((), (), ())
    assert right.effects == (TONE, GLARE)
    assert len(right.warnings) == len(right.notes) == 1


@pytest.mark.parametrize(
    ("name", "causes", "quantity"),
    [
        ("unsteady response", ("sun or lamps in or near the view", "haze", "fog"), "exponent"),
        ("unsteady vignette", ("glossy", "a lamp on the camera"), "change of ln vignette per half diagonal"),
        ("black level by exposure", ("or the light changed",), "share of white per e-fold exposure"),
        ("uneven vignette", ("wipers", "reflections in a window"), "deviation of ln vignette"),
    ],
)
def test_a_contradiction_names_its_causes_and_size(name, causes, quantity):
    fit = replace(FIT, effect_estimates=(EffectEstimate(name, 0.1, 0.01, contradicts=True),))
    (warning,) = calibration_of(with_fit(fit), DefaultSettings()).warnings
    assert all(cause in warning for cause in causes)
    assert warning.endswith(f"({quantity}: 0.1 ± 0.01)")
