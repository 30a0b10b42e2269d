"""The covariance of the parameters, checked with scores of known distribution."""

import numpy as np
import pytest

from ospc.arrays import FloatArray
from ospc.estimation.normal_equations import NormalEquations, at_least
from ospc.estimation.prior import Prior, PriorHyperparameters
from ospc.estimation.response_basis import ResponseBasis, typical_gamma
from ospc.estimation.shared_errors import SharedErrors
from ospc.estimation.vignette_basis import VignetteBasis

BASIS, SIGNAL = ResponseBasis(8), 400.0
NO_ERRORS = np.zeros((0, len(BASIS)))


def sigma_of_first(halves: FloatArray, expected: FloatArray = NO_ERRORS) -> FloatArray:
    """Return the sigmas of the parameters with equal information on each, given scores of shared errors."""
    prior = Prior(BASIS, VignetteBasis(0), typical_gamma(BASIS.knots), np.empty(0))
    flat = PriorHyperparameters(1.0, 0.0, 0.0)
    information = SIGNAL * np.eye(len(BASIS))
    equations = NormalEquations(information, np.zeros(len(BASIS)), information)
    return np.asarray(np.sqrt(np.diag(equations.covariance(prior, flat, SharedErrors(halves, expected)))))


def test_rounding_errors_are_not_taken_for_data() -> None:
    rounded = NormalEquations(np.diag([-4e-16, 2e-16]), np.zeros(2), 1e-27 * np.eye(2), blocks=20)
    assert rounded.scaled(np.eye(2), 1.0).information_scale > 1e-6


def test_halves_that_differ_by_chance_hardly_widen_the_bands() -> None:
    plain = sigma_of_first(np.zeros((4, len(BASIS))))
    random = np.random.default_rng(0)
    widened = [sigma_of_first(np.sqrt(SIGNAL) * random.standard_normal((4, len(BASIS)))) / plain for _ in range(40)]
    assert np.mean(widened) < 1.25


@pytest.mark.parametrize("sigmas", [10.0, 30.0])
def test_halves_that_differ_by_more_widen_the_band_by_the_difference(sigmas: float) -> None:
    plain = sigma_of_first(np.zeros((4, len(BASIS))))
    halves = np.zeros((4, len(BASIS)))
    halves[2, 3] = sigmas * np.sqrt(SIGNAL)
    found = sigma_of_first(halves)
    assert found[3] / plain[3] == pytest.approx(sigmas, rel=0.15)
    assert found[0] == pytest.approx(plain[0], rel=0.15)


def test_expected_errors_widen_the_band_by_what_they_change() -> None:
    plain, error = sigma_of_first(np.zeros((4, len(BASIS)))), 0.1
    expected = SIGNAL * error * np.eye(len(BASIS))[[3]]  # the parameter's information times its error
    found = sigma_of_first(np.zeros((4, len(BASIS))), expected)
    assert np.sqrt(found[3] ** 2 - plain[3] ** 2) == pytest.approx(error, rel=0.15)
    assert found[0] == pytest.approx(plain[0], rel=0.15)


@pytest.mark.parametrize("seed", range(5))
def test_a_covariance_is_widened_just_where_it_is_smaller_than_another(seed: int) -> None:
    random = np.random.default_rng(seed)
    one, other = (root @ root.T for root in random.normal(size=(2, 6, 6)))
    wider = at_least(one, np.linalg.inv(other))
    for smaller in (one, other):
        assert np.linalg.eigvalsh(wider - smaller).min() > -1e-9 * np.trace(wider)
    # The bound is tight: if one covariance exceeds the other in all directions, it is returned.
    np.testing.assert_allclose(at_least(one, np.linalg.inv(one / 2)), one, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(at_least(one / 2, np.linalg.inv(one)), one, rtol=1e-6, atol=1e-9)
