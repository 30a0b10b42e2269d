"""Figures agree with the metrics, and are missing if the estimate or the truth is missing."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest

from ospc.errors import ExposureError
from ospc.evaluation.metrics import log_ratio_error, response_rmse, response_shape_rmse, vignette_rmse
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import PolynomialVignette
from ospc.research.measurement import METRICS, Measurement, medians
from ospc.research.method import Estimate
from ospc.research.scoring import Truth, exposure_error, score
from ospc.research.source import SimulatedSource, judge_one
from ospc.simulation import SimulationSettings

SIZE = (64, 48)
TRUTH = Truth(Response.gamma(2.0), PolynomialVignette(SIZE, (-0.3, 0.0, -0.1)))
SOURCE = SimulatedSource("a", SimulationSettings(size=SIZE, frames=2), factors={"noise": "low"})


def response(exponent, sigma=None):
    table = np.linspace(0, 1, 256) ** exponent
    return Response(table, log_sigma=None if sigma is None else np.full(256, sigma))


def calibration(exponent=2.1, sigma=None, fall=-0.32, vignette_sigma=None):
    return Calibration(
        SIZE,
        response(exponent, sigma),
        PolynomialVignette(SIZE, (fall, 0.0, -0.1)),
        {"response": Verdict("identifiable", "well seen")},
        None if vignette_sigma is None else np.full(51, vignette_sigma),
    )


def test_figures_are_those_of_the_metrics():
    made = calibration()
    figures = score(Estimate.of(made), TRUTH)
    assert figures["response_rmse"] == response_rmse(made.response, TRUTH.response)
    assert figures["response_shape_rmse"] == response_shape_rmse(made.response, TRUTH.response)
    assert figures["log_ratio_error"] == log_ratio_error(made.response, TRUTH.response)
    assert figures["vignette_rmse"] == vignette_rmse(made.vignette, TRUTH.vignette)
    assert "ratio_median_abs" not in figures
    assert "response_within_1_sigma" not in figures
    assert figures.keys() <= {metric.figure for metric in METRICS}


def test_an_estimate_that_differs_by_nothing_has_no_error():
    table = TRUTH.response.inverse_table + 1e-15 * np.arange(256)
    figures = score(Estimate(Response(table), PolynomialVignette(SIZE, (-0.3, 0.0, -0.1))), TRUTH)
    assert list(figures.values()) == pytest.approx([0.0] * 5, abs=1e-12)


def test_the_truth_itself_is_judged_by_its_predictions_alone():
    assert score(Estimate(TRUTH.response), TRUTH) == {}


def test_verdicts_and_the_place_in_the_study_are_kept():
    row = judge_one(SOURCE, "m", Estimate.of(calibration()), TRUTH)
    assert (row.recording, row.method, row.group, row.factors) == ("a", "m", "simulated", {"noise": "low"})
    assert row.states == {"response": "identifiable"}
    assert row.reasons == {"response": "well seen"}
    assert row.problem == ""
    assert len(row.curves["response"]) == 256
    assert len(row.curves["vignette"]) == 50


def test_failures_and_empty_results_are_problems():
    assert judge_one(SOURCE, "m", "it is too dark", TRUTH).problem == "it is too dark"
    empty = judge_one(SOURCE, "m", Estimate(), TRUTH)
    assert "neither response nor vignette" in empty.problem
    reasons = {"response": Verdict("not identifiable", "exposures do not change")}
    unsure = judge_one(SOURCE, "m", Estimate.of(Calibration(SIZE, verdicts=reasons)), TRUTH)
    assert unsure.problem == "exposures do not change"


def test_unknown_parts_have_no_figures():
    assert score(Estimate(), TRUTH) == {}
    assert score(Estimate.of(calibration()), Truth()) == {}


def test_a_partly_known_response_is_judged_by_shape_within_its_range():
    made = calibration()
    figures = score(Estimate.of(made), Truth(TRUTH.response, greys=(40, 120)))
    assert figures == {"response_shape_rmse": response_shape_rmse(made.response, TRUTH.response, 40, 120)}


def test_vignettes_of_other_sizes_are_compared_by_their_profiles():
    figures = score(Estimate(vignette=PolynomialVignette((128, 96), (-0.3, 0.0, -0.1))), TRUTH)
    assert figures == {"vignette_rmse": pytest.approx(0, abs=0.01)}


def test_coverage_counts_points_within_the_stated_uncertainty():
    estimate = response(2.1)
    # Level 0 and the reference level have no shape error, and level 0 has no band.
    error = np.abs(1 - estimate.matched(TRUTH.response)[1:] / estimate.inverse_table[1:])
    sigma = float(np.median(error))
    figures = score(Estimate.of(calibration(sigma=sigma, vignette_sigma=1.0)), TRUTH)
    assert figures["response_within_1_sigma"] == pytest.approx(0.5, abs=0.01)
    assert figures["response_within_2_sigma"] == pytest.approx(np.mean(error <= 2 * sigma))
    assert figures["vignette_within_1_sigma"] == 1.0


def test_exposures_are_compared_up_to_a_factor():
    values = np.exp(np.sin(np.arange(8)))
    true = dict(enumerate(values))
    assert exposure_error(dict(enumerate(7 * values)), true) == pytest.approx(0, abs=1e-12)
    assert exposure_error(dict(enumerate(values**1.5)), true) == pytest.approx(0.5 * np.std(np.log(values)))
    with pytest.raises(ExposureError, match="1 of which are not"):
        exposure_error(dict(enumerate(values, start=1)), true)
    with pytest.raises(ExposureError, match="above 0"):
        exposure_error(dict(enumerate(-values)), true)


def test_measurements_survive_the_way_through_json():
    row = judge_one(SOURCE, "m", Estimate.of(calibration(sigma=0.1)), TRUTH)
    assert Measurement(**asdict(row)) == row


def test_a_median_counts_failures_but_not_unknown_truths():
    """Charts have no true vignette; elsewhere, a method that gives no vignette has failed."""
    simulated = [
        measured("a", "one", 0.1),
        measured("b", "one", 0.3),
        measured("a", "two", 0.2),
        measured("b", "two"),
    ]
    charts = [Measurement("c", method, {"log_ratio_error": 0.5}, group="charts") for method in ("one", "two")]
    found = medians([*simulated, *charts], "vignette_rmse")
    assert found["one"] == pytest.approx(0.2)
    assert found["two"] == math.inf
    assert medians(charts, "vignette_rmse") == {"one": math.inf, "two": math.inf}


def measured(recording, method, vignette_rmse=None):
    figures = {} if vignette_rmse is None else {"vignette_rmse": vignette_rmse}
    return Measurement(recording, method, figures, group="simulated")
