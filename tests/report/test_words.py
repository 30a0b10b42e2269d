"""The sentences of a report are correct, with significant digits only."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from recordings import SIZE, calibration

from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import LogSplineVignette, PolynomialVignette, RasterVignette
from ospc.report.words import facts, headline, overall_state

WELL, ROUGH, LOST = (Verdict(state, "why") for state in ("identifiable", "marginal", "not identifiable"))


@pytest.mark.parametrize(
    ("response", "vignette", "sentence", "state"),
    [
        (WELL, WELL, "The response and the vignette of this camera are well determined.", "identifiable"),
        (
            WELL,
            ROUGH,
            "The response of this camera is well determined. The vignette is known only approximately.",
            "marginal",
        ),
        (
            LOST,
            LOST,
            "This recording does not determine the response and the vignette; no estimate is given.",
            "not identifiable",
        ),
    ],
)
def test_the_headline_states_the_result(response, vignette, sentence, state):
    known = calibration(verdicts={"response": response, "vignette": vignette})
    assert headline(known) == sentence
    assert overall_state(known) == state


def test_three_parts_are_listed_with_commas_and_and():
    known = calibration(verdicts=dict.fromkeys(("response", "vignette", "exposures"), WELL))
    assert headline(known).startswith("The response, the vignette and the exposures of this camera are well")


@pytest.mark.parametrize(
    ("exposures", "sentence"),
    [
        (WELL, "The exposures of this camera are well determined."),
        (ROUGH, "The exposures are known only approximately."),
        (LOST, "The exposures could not be confirmed."),
    ],
)
def test_exposures_are_plural_and_not_estimated(exposures, sentence):
    assert headline(calibration(verdicts={"exposures": exposures})) == sentence
    others = {"response": LOST, "vignette": LOST}
    assert sentence in headline(calibration(verdicts=others | {"exposures": exposures}))


def fact_text(**changes):
    return " ".join(facts(calibration(**changes)))


def test_the_text_states_middle_grey_and_ratio_uncertainty():
    assert (
        "Middle grey (128 of 255) corresponds to 25.0 ± 0.9 % of the irradiance that saturates the sensor"
        in fact_text()
    )
    assert "Between grey levels 13 and 230 the ratio of two irradiances is known to ±1.6 %" in fact_text()
    assert "linear camera" in fact_text(response=Response.gamma(1.0))


def test_the_stated_gamma_exponent_matches_the_stated_irradiance():
    bent = Response(np.interp(np.linspace(0, 1, 256), [0, 0.5, 1], [0, 0.268, 1]))
    exponent = float(re.search(r"exponent ([\d.]+)\.", fact_text(response=bent)).group(1))
    assert 0.5**exponent == pytest.approx(0.268, abs=0.003)


def test_the_text_states_the_attenuation_at_the_corners():
    assert "The corners receive 60 ± 2 % of the light at the centre, 0.7 stops less." in fact_text()
    assert "hardly any vignetting" in fact_text(vignette=PolynomialVignette(SIZE, (-0.005, 0.0, 0.0)))


def test_the_text_states_where_the_vignette_is_unknown_instead_of_corners():
    text = fact_text(vignette=LogSplineVignette(SIZE, (-0.3, -0.3), limit=0.7))
    assert "Beyond 0.70 half diagonals from its centre, the vignette is unknown and taken as constant." in text
    assert "corners" not in text


def test_the_text_states_unequal_corners_and_an_off_centre_maximum():
    x, y = np.meshgrid(np.linspace(-1, 1, SIZE[0]), np.linspace(-1, 1, SIZE[1]))
    decentred = RasterVignette((1 - 0.2 * ((x - 0.4) ** 2 + y**2)).astype(np.float32))
    text = fact_text(vignette=decentred)
    low, high = (100 * (1 - 0.2 * (x**2 + 1)) / (1 - 0.2 * 0.4**2) for x in (1.4, 0.6))
    assert f"on average ({low:.0f} to {high:.0f} %)" in text
    assert "relative to the brightest point, as in vignette.png" in text


def test_the_stated_corners_match_the_saved_profile():
    known = calibration()
    share = float(re.search(r"receive ([\d.]+)", fact_text()).group(1))
    assert share == pytest.approx(100 * known.as_dict()["vignette"]["profile"][-1], abs=0.5)


def test_the_agreement_of_exposures_weights_pairs_by_their_samples():
    k = np.geomspace(0.5, 2, 40)
    wrong = np.arange(40) % 4 > 0
    frames = np.stack([np.arange(40), np.arange(40) + 1], axis=1)
    ratios = ExposureRatios(frames, k, np.where(wrong, k * 3, k * np.exp(0.02)), np.where(wrong, 4, 200))
    assert "agree with the metadata to 2.0 % (median over 40 pairs" in fact_text(exposure_ratios=ratios)


def test_the_text_separates_median_and_worst_uncertainty():
    spread = np.full(256, 0.001)
    spread[:30] = 0.4
    sure = replace(Response.gamma(2.0), log_sigma=spread, scale_sigma=0.001)
    assert "is known to ±0.1 % typically and ±40 % at worst" in fact_text(response=sure)
