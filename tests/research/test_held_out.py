"""Predicted exposure ratios: exact for the true calibration, with the expected errors for wrong ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.research.scoring import PAIRS, prediction_error, simulated_pairs
from ospc.simulation import SimulationSettings

SETTINGS = SimulationSettings(size=(160, 120), response=Response.gamma(2.0, 4097), noise="high", moving_objects=2)
STILL = replace(SETTINGS, motion="static")
TRUE_VIGNETTE = PolynomialVignette(SETTINGS.size, SETTINGS.vignette_coefficients)


@pytest.fixture(scope="module")
def pairs():
    return simulated_pairs(SETTINGS)


def test_there_are_enough_pairs_with_ratios_on_both_sides(pairs):
    assert len(pairs) == PAIRS
    log_k = np.log([pair.exposure_ratio for pair in pairs])
    assert np.all((np.abs(log_k) >= 0.1) & (np.abs(log_k) <= 1.0))
    assert 0.3 < np.mean(log_k > 0) < 0.7


def test_the_truth_predicts_exactly(pairs):
    assert prediction_error(pairs, SETTINGS.response, TRUE_VIGNETTE)[0] < 1e-6


def test_a_wrong_exponent_shows_as_a_bias_of_that_exponent(pairs):
    exponent = 1.1
    squared = PolynomialVignette(SETTINGS.size, (0.0, 0.0, 0.0))
    still = simulated_pairs(STILL)
    _, bias = prediction_error(still, Response.gamma(2.0 * exponent, 4097), squared)
    typical = np.median(np.abs(np.log([pair.exposure_ratio for pair in still])))
    assert bias == pytest.approx((exponent - 1) * typical, rel=0.02)


def test_a_missing_vignette_shows_where_the_camera_turns_only(pairs):
    assert prediction_error(pairs, SETTINGS.response, None)[0] > 0.01
    still = simulated_pairs(STILL)
    assert prediction_error(still, SETTINGS.response, None)[0] < 1e-6


def test_scale_of_the_response_does_not_matter(pairs):
    table = SETTINGS.response.inverse_table.copy()
    table[-1] = 1.5
    found = prediction_error(pairs, Response.from_values(table), TRUE_VIGNETTE)
    assert found[0] < 1e-6
