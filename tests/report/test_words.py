"""What a report says is true, in digits that mean something."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import SIZE, calibration, coverage

from ospc.photometry.calibration import ExposureRatios, Verdict
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.report.words import (
    facts,
    headline,
    least_samples,
    misfit_of,
    overall_state,
    uncovered_greys,
    uncovered_radii,
)

WELL, ROUGH, LOST = (Verdict(state, "why") for state in ("identifiable", "marginal", "not identifiable"))


@pytest.mark.parametrize(
    ("response", "vignette", "sentence", "state"),
    [
        (WELL, WELL, "The response and the vignette of this camera are known well.", "identifiable"),
        (WELL, ROUGH, "The response of this camera is known well. The vignette is known only roughly.", "marginal"),
        (
            LOST,
            LOST,
            "This recording does not tell the response and the vignette, so none is given.",
            "not identifiable",
        ),
    ],
)
def test_the_headline_says_what_is_known(response, vignette, sentence, state):
    known = calibration(verdicts={"response": response, "vignette": vignette})
    assert headline(known) == sentence
    assert overall_state(known) == state


def said(**changes):
    return " ".join(facts(calibration(**changes)))


def test_the_middle_grey_is_that_of_the_response():
    assert "Middle grey (128 of 255) is 25 ± 2 % of the light that saturates the sensor" in said()
    assert "a gamma curve with exponent 2." in said()
    assert "as of a linear camera" in said(response=Response.gamma(1.0))


def test_the_corners_are_those_of_the_vignette():
    assert "The corners get 61 ± 2 % of the light of the centre, 0.7 stops less." in said()
    assert "there is hardly a vignette" in said(vignette=PolynomialVignette(SIZE, (-0.005, 0.0, 0.0)))


def test_agreement_is_the_median_over_well_founded_pairs():
    k = np.geomspace(0.5, 2, 40)
    wrong = np.arange(40) % 4 == 0
    ratios = ExposureRatios(
        np.stack([np.arange(40), np.arange(40) + 1], axis=1),
        k,
        np.where(wrong, k * 3, k * np.exp(0.02)),
        np.where(wrong, 60, 200),
    )
    assert least_samples(ratios) == 120
    assert misfit_of(ratios) == pytest.approx(0.02)
    assert "agree with those stated to 2.0 %" in said(exposure_ratios=ratios)
    few = ExposureRatios(ratios.frames, k, ratios.estimated, np.full(40, 10))
    assert misfit_of(few) == pytest.approx(0.02)
    assert np.isnan(misfit_of(ExposureRatios.none()))


def test_gaps_are_named_by_their_ends():
    assert uncovered_greys(coverage(), 255) == "grey levels 0–32"
    assert uncovered_greys(coverage(), 4095) == "grey levels 0–512"
    assert uncovered_radii(coverage()) == "radii 0.90–1.00"
    assert uncovered_radii(coverage(still=True)) == ""
