"""Figures follow the metrics, and are missing where nothing is stated or known."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.benchmark.case import Figures, Row
from ospc.benchmark.scoring import profile_along_diagonal, score
from ospc.evaluation.metrics import log_ratio_error, response_rmse, response_shape_rmse, vignette_rmse
from ospc.photometry.calibration import PROFILE_RADII, Calibration, Verdict
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette

SIZE = (64, 48)
TRUTH = Response.gamma(2.0), PolynomialVignette(SIZE, (-0.3, 0.0, -0.1))


def response(exponent, sigma=None):
    table = np.linspace(0, 1, 256) ** exponent
    return Response(table, inverse_sigma=None if sigma is None else np.full(256, sigma))


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
    figures = score("a", made, *TRUTH).figures
    assert figures.response_rmse == response_rmse(made.response, TRUTH[0])
    assert figures.response_shape_rmse == response_shape_rmse(made.response, TRUTH[0])
    assert figures.log_ratio_error == log_ratio_error(made.response, TRUTH[0])
    assert figures.vignette_rmse == vignette_rmse(made.vignette, TRUTH[1])
    assert figures.ratio_median_abs is None
    assert figures.response_within_1_sigma is None


def test_the_truth_has_no_error_and_verdicts_are_kept():
    row = score("a", calibration(2.0, fall=-0.3), *TRUTH)
    known = [v for v in vars(row.figures).values() if v is not None]
    assert known == pytest.approx([0.0] * len(known), abs=1e-12)
    assert row.states == {"response": "identifiable"}
    assert row.reasons == {"response": "well seen"}


def test_unknown_parts_have_no_figures():
    assert score("a", Calibration(SIZE), *TRUTH).figures == Figures()
    figures = score("a", calibration(), None, None).figures
    assert figures == Figures()


def test_where_the_truth_is_known_in_part_only_the_shape_counts_and_only_there():
    made = calibration()
    figures = score("a", made, TRUTH[0], None, greys=(40, 120)).figures
    assert figures == Figures(response_shape_rmse=response_shape_rmse(made.response, TRUTH[0], 40, 120))


def test_coverage_counts_points_within_the_stated_uncertainty():
    error = np.abs(response(2.1).inverse_table - TRUTH[0].inverse_table)[5:251]
    sigma = float(np.median(error))
    figures = score("a", calibration(sigma=sigma, vignette_sigma=1.0), *TRUTH).figures
    assert figures.response_within_1_sigma == pytest.approx(0.5, abs=0.01)
    assert figures.response_within_2_sigma == pytest.approx(np.mean(error <= 2 * sigma))
    assert figures.vignette_within_1_sigma == 1.0


def test_profile_begins_at_one_and_is_that_of_the_model():
    found = profile_along_diagonal(TRUTH[1])
    assert found == pytest.approx(TRUTH[1].profile(PROFILE_RADII), abs=1e-9)


def test_rows_survive_the_way_through_json():
    row = score("a", calibration(sigma=0.1, vignette_sigma=0.1), *TRUTH)
    assert Row.from_dict(row.as_dict()) == row
