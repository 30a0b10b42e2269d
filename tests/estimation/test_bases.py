"""Bases checked against quadrature and finite differences, and the linear solver against SciPy."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from ospc.estimation.effects import Effects
from ospc.estimation.model import Model
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.prior import START, Prior, vignette_precision
from ospc.estimation.response_basis import FUNCTIONS, ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.settings.fit import MAX_GAMMA, MAX_GAMMA_CHANGE
from response_functions import HatsCrowdedAtBlack

seeds = st.integers(0, 2**32 - 1)
intervals = st.sampled_from([8, 16, 32])


def gamma_at(basis, coefficients, grey):
    """Evaluate the local gamma by linear interpolation between the knots, as in its definition."""
    return np.interp(grey, basis.knots, coefficients)


# Response


@given(intervals, st.floats(0.1, 5.0))
def test_a_constant_local_gamma_is_a_power(n, exponent):
    basis = ResponseBasis(n)
    constant = np.full(len(basis), exponent)
    np.testing.assert_allclose(basis.gamma_of(constant), exponent, rtol=1e-12)
    np.testing.assert_allclose(basis.log_of(constant)[1:], exponent * np.log(basis.grid[1:]), rtol=0, atol=1e-11)
    grey = np.linspace(0.05, 1, 77)
    np.testing.assert_allclose(basis.log_rows(grey) @ constant, exponent * np.log(grey), atol=2e-5 * exponent)


@pytest.mark.parametrize("n", [8, 16, 32])
def test_tables_are_the_integrals_they_stand_for(n):
    from scipy.integrate import quad  # slow to import

    basis = ResponseBasis(n)
    coefficients = np.random.default_rng(n).uniform(0.2, 3, len(basis))
    at = np.array([1, 2, 40, 77, 1000, 2048, 2049, 3500, 4095])
    for index in at:
        grey = basis.grid[index]
        inner = [k for k in basis.knots if grey < k < 1]
        expected = -quad(
            lambda m: gamma_at(basis, coefficients, m) / m, grey, 1, points=inner or None, limit=200, epsabs=1e-12
        )[0]
        assert basis.log_of(coefficients)[index] == pytest.approx(expected, abs=1e-9)
    np.testing.assert_allclose(basis.gamma_of(coefficients), gamma_at(basis, coefficients, basis.grid), atol=1e-12)


@given(st.integers(2, 40), seeds)
def test_any_positive_coefficients_make_a_strictly_increasing_curve_that_ends_at_one(n, seed):
    basis = ResponseBasis(n)
    curve = basis.log_of(np.random.default_rng(seed).uniform(1e-3, 20, len(basis)))
    assert curve[-1] == 0
    assert np.all(np.diff(curve) > 0)


@given(intervals, seeds, st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=20))
def test_rows_give_the_curve_anywhere(n, seed, grey):
    basis = ResponseBasis(n)
    coefficients = np.random.default_rng(seed).uniform(0.2, 3, len(basis))
    expected = np.interp(np.clip(grey, 0, 1), basis.grid, basis.log_of(coefficients))
    np.testing.assert_allclose(basis.log_rows(grey) @ coefficients, expected, atol=1e-10)


# Vignette


vignette_bases = st.builds(VignetteBasis, st.integers(0, 4), st.booleans(), st.booleans())


def parameters_of(basis, seed):
    random = np.random.default_rng(seed)
    parameters = random.normal(0, 0.3, len(basis))
    parameters[basis.radial : basis.radial + 2 * basis.free_centre] *= 0.2
    return parameters, random.uniform(-0.7, 0.7, (15, 2))


@given(vignette_bases, seeds)
def test_the_value_is_the_logarithm_of_the_vignette(basis, seed):
    parameters, position = parameters_of(basis, seed)
    size = (64, 48)
    vignette = basis.vignette(parameters, size)
    assert vignette.size == size
    np.testing.assert_allclose(
        basis.log_value(parameters, position), np.log(vignette.at_normalised(position)), atol=1e-12
    )
    everywhere = normalised(pixel_grid(size), size).reshape(-1, 2)
    np.testing.assert_allclose(
        np.exp(basis.log_value(parameters, everywhere)), vignette.image().ravel(), rtol=1e-5, atol=0
    )
    centre = basis.centre(parameters)
    assert basis.log_value(parameters, centre[None])[0] == pytest.approx(0, abs=1e-12)
    assert len(basis.names) == len(basis)


def assert_jacobian(basis, seed):
    parameters, position = parameters_of(basis, seed)
    jacobian = basis.jacobian(parameters, position)
    assert jacobian.shape == (len(position), len(basis))
    step = 1e-6
    for i, unit in enumerate(np.eye(len(basis))):
        ends = [basis.log_value(parameters + s * step * unit, position) for s in (1, -1)]
        np.testing.assert_allclose(jacobian[:, i], (ends[0] - ends[1]) / (2 * step), atol=1e-7)


def test_beyond_the_last_observations_the_error_grows_with_the_square_of_the_distance():
    basis = VignetteBasis(16, free_centre=True)
    bent = np.concatenate([-0.5 * basis.spline.knots, np.zeros(2)])
    place = np.array([[0.3, 0.4], [0.5, 0.5], [0.6, 0.7], [0.6, 0.8]])

    def sigma(parameters, radius):
        rows = basis.jacobian(parameters, place)
        return np.sqrt(np.einsum("ij,jk,ik->i", rows, basis.unseen(parameters, radius), rows))

    # The slope is -R²/2 up to a knot at R² = 0.4, and its rate of change beyond is uncertain by half of that.
    expected = np.maximum(np.sum(place**2, axis=1) - 0.4, 0) ** 2 / 8
    np.testing.assert_allclose(sigma(bent, np.sqrt(0.4)), expected, rtol=0.2, atol=7e-4)
    assert not np.any(sigma(bent, 1.2))
    assert not np.any(sigma(np.full(18, -0.5), 0.5))
    assert not np.any(VignetteBasis(0).unseen(np.empty(0), 0.5))


def test_the_uncertain_rate_increases_only_for_a_vignette_that_would_soon_reach_zero():
    basis, corner, radius = VignetteBasis(16), np.array([[0.6, 0.8]]), np.sqrt(0.9)

    def sigma_over_rate(fall):
        parameters = -fall * (1 + basis.spline.knots)
        row = basis.jacobian(parameters, corner)[0]
        return np.sqrt(row @ basis.unseen(parameters, radius) @ row) / fall

    assert sigma_over_rate(0.2) == pytest.approx(sigma_over_rate(0.5))
    assert sigma_over_rate(3.0) > 1.5 * sigma_over_rate(0.5)
    assert np.isfinite(sigma_over_rate(1e3))


@pytest.mark.parametrize("usable_radius", [0.6, 1.0])
@pytest.mark.parametrize(("centre", "changes"), [((0.0, 0.0), False), ((0.05, 0.03), False), ((0.15, -0.1), True)])
def test_the_last_knot_is_never_closer_to_the_centre_than_the_farthest_corner(centre, usable_radius, changes):
    basis = VignetteBasis(16, free_centre=True, usable_radius=usable_radius)
    found = replace(basis, reach=basis.reach_of_far_corner(np.array([*np.zeros(16), *centre])))
    assert (found != basis) == changes
    assert found.spline.reach >= usable_radius + np.hypot(*centre)
    assert found.reach < 1.2 + np.hypot(*centre) / usable_radius
    assert np.isfinite(np.linalg.cholesky(vignette_precision(found, 0.1)[0])).all()


def test_beyond_the_last_knot_the_slope_may_go_on_to_change_at_the_rate_before():
    """The slope of -R⁴ in R² is -2 R²; beyond the last knot, that of the basis is constant."""
    basis, squared = VignetteBasis(16), np.array([1.2, 1.3, 1.5])
    parameters, place = -2 * basis.spline.knots, np.stack([np.sqrt(squared), np.zeros(3)], axis=1)
    error = basis.log_value(parameters, place) + squared**2
    np.testing.assert_allclose(basis.unresolved(parameters, place), np.abs(error), atol=1e-9)


@given(vignette_bases, seeds)
def test_the_jacobian_is_that_of_finite_differences(basis, seed):
    assert_jacobian(basis, seed)


@given(st.integers(1, 16), seeds)
def test_a_vignette_keeps_its_values_in_a_basis_with_the_same_knots(radial, seed):
    whole = VignetteBasis(radial, free_centre=True, non_radial=True, usable_radius=0.7)
    parameters, position = parameters_of(whole, seed)
    finer = replace(whole, radial=2 * radial - 1)
    if radial > 1:
        converted = finer.conversion(whole) @ parameters
        np.testing.assert_allclose(
            finer.log_value(converted, position), whole.log_value(parameters, position), atol=1e-12
        )
        np.testing.assert_allclose(whole.conversion(finer) @ converted, parameters, atol=1e-12)
    simpler = replace(whole, free_centre=False, non_radial=False)
    np.testing.assert_array_equal(simpler.conversion(whole) @ parameters, parameters[:radial])


@given(st.integers(2, 20), st.floats(0.3, 1.0), st.sampled_from([1.1, 1.25]), st.floats(0.0, 10.0))
def test_the_prior_of_the_vignette_is_a_smooth_curve_and_a_random_walk_of_its_slope(
    radial, usable_radius, reach, walk
):
    basis = VignetteBasis(radial, usable_radius=usable_radius, reach=reach)
    precision, log_determinant = vignette_precision(basis, walk)
    knots, order = basis.spline.knots, np.arange(1, 200)
    # ln V = Σ aₖ R²ᵏ with standard deviations 2 / (k D^(2(k - 1))) has the slopes Σ k aₖ R^(2(k - 1)).
    slopes = 2 * (knots[:, None] / ((reach + 0.1) * usable_radius) ** 2) ** (order - 1)
    covariance = slopes @ slopes.T + walk**2 / usable_radius**5 * np.sqrt(np.minimum.outer(knots, knots))
    np.testing.assert_allclose(np.linalg.inv(precision), covariance, atol=1e-3, rtol=1e-3)
    assert log_determinant == pytest.approx(np.linalg.slogdet(precision)[1])


def test_the_prior_at_a_grey_level_does_not_depend_on_the_other_knots(monkeypatch):
    monkeypatch.setitem(FUNCTIONS, "crowded", HatsCrowdedAtBlack())
    common = []
    for name, at in (("hats", [0, 2, 8]), ("crowded", [0, 4, 8])):
        basis = ResponseBasis(8, name)
        np.testing.assert_array_equal(basis.knots[at], [0, 0.25, 1])
        prior = Prior(basis, VignetteBasis(0), np.ones(9), np.zeros(0))
        common.append(np.linalg.inv(prior.precision(START))[np.ix_(at, at)])
    np.testing.assert_allclose(*common, rtol=1e-6)


# Linear system


@dataclass(frozen=True)
class Belief:
    """A normal prior on the parameters that ignores the hyperparameters."""

    mean: np.ndarray
    matrix: np.ndarray

    def precision(self, _roughness):
        return self.matrix


def belief(random, p):
    root = random.normal(0, 1, (p, p))
    return Belief(random.normal(0.5, 1, p), root @ root.T + 0.1 * np.eye(p))


@given(seeds, st.booleans(), st.floats(0.2, 3.0))
def test_the_solution_is_that_of_a_bounded_least_squares_solver(seed, bounded, information_scale):
    random = np.random.default_rng(seed)
    prior = belief(random, 10)
    rows, target = random.normal(0, 1, (30, 10)), random.normal(0, 2, 30)
    floor = np.full(10, -np.inf)
    if bounded:
        floor[:7] = 0.3
    equations = NormalEquations(rows.T @ rows, rows.T @ target, np.eye(10), information_scale)
    found = equations.solve(prior, START, floor)
    assert np.all(found >= floor)
    # Write the prior as extra rows: precision = RᵀR, with R·mean on the right-hand side.
    root = np.linalg.cholesky(prior.matrix).T
    system = np.vstack([np.sqrt(information_scale) * rows, root])
    right = np.concatenate([np.sqrt(information_scale) * target, root @ prior.mean])
    reference = lsq_linear(system, right, bounds=(floor, np.inf), tol=1e-14)
    np.testing.assert_allclose(found, reference.x, atol=1e-5)
    cost = [np.sum((system @ x - right) ** 2) for x in (found, reference.x)]
    assert cost[0] <= cost[1] * (1 + 1e-9)
    np.testing.assert_allclose(equations.posterior_precision(prior, START), system.T @ system, rtol=1e-9, atol=1e-9)


@given(seeds, st.sampled_from([(), (3,)]))
def test_the_evidence_of_a_knee_is_the_difference_of_the_evidences(seed, present):
    basis, random = ResponseBasis(8), np.random.default_rng(seed)
    prior = Prior(basis, VignetteBasis(0), random.uniform(0.5, 4, 9), np.zeros(0))
    rows = random.normal(0, 1, (5, 9))
    equations = NormalEquations(rows.T @ rows, rows.T @ random.normal(2, 1, 5), np.eye(9), random.uniform(0.1, 1))
    candidates = replace(START, knees=present).response_candidates[::7]
    gains = equations.log_evidence_of_knees(prior, candidates)
    for knee in (1, 4, 7):
        with_knee = [replace(candidate, knees=(*present, knee)) for candidate in candidates]
        gained = equations.log_evidence(prior, with_knee) - equations.log_evidence(prior, candidates)
        np.testing.assert_allclose(gains[:, knee - 1], gained, rtol=1e-3, atol=1e-3)


def test_the_roughness_chosen_is_the_one_under_which_the_data_are_most_probable():
    basis, vignette = ResponseBasis(8), VignetteBasis(6)
    random = np.random.default_rng(0)
    for bend in (0.0, 0.3, 1.0):
        prior = Prior(basis, vignette, np.full(len(basis), 2.0), np.full(1, 2.0))
        slopes = -0.4 - bend * (vignette.spline.knots > 0.5)
        truth = np.concatenate([2 + bend * np.sin(9 * basis.knots), slopes, [-0.3]])
        rows = random.normal(0, 1, (40, len(truth)))
        target = rows @ truth + random.normal(0, 1, 40)
        equations = NormalEquations(rows.T @ rows, rows.T @ target, np.eye(len(truth)))

        def log_probability(hyperparameters, prior=prior, rows=rows, target=target):
            spread = np.eye(40) + rows @ np.linalg.inv(prior.precision(hyperparameters)) @ rows.T
            rest = target - rows @ prior.mean
            return -0.5 * (rest @ np.linalg.solve(spread, rest) + np.linalg.slogdet(2 * np.pi * spread).logabsdet)

        chosen = equations.maximize_evidence(prior, START)
        best = max(map(log_probability, START.response_candidates))
        of_response = replace(chosen, vignette_walk=START.vignette_walk)
        assert log_probability(of_response) == pytest.approx(best, abs=1e-6)
        assert log_probability(chosen) == pytest.approx(
            max(map(log_probability, chosen.vignette_candidates)), abs=1e-6
        )


def test_errors_common_to_a_group_leave_as_little_information_as_there_are_groups():
    random = np.random.default_rng(0)
    weak = 1e-3 * np.eye(5)
    members, groups = 20, 400
    rows = np.repeat(random.normal(0, 1, (groups, 5)), members, axis=0)
    for common, expected in ((0.0, 1.0), (1.0, 1 / members)):
        own = random.normal(0, 1, groups * members)
        residual = np.sqrt(common) * np.repeat(random.normal(0, 1, groups), members) + np.sqrt(1 - common) * own
        scores = (rows * residual[:, None]).reshape(groups, members, -1).sum(axis=1)
        equations = NormalEquations(rows.T @ rows, rows.T @ residual, scores.T @ scores, blocks=groups)
        scaled = equations.scaled(weak, 1.0)
        assert scaled.information_scale == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("before", [1.0, 90.0])
def test_a_step_of_a_fit_leaves_every_gamma_plausible(before):
    model = Model(ResponseBasis(8), VignetteBasis(0), Effects())
    after = model.limited(np.full(9, 1e6), np.full(9, before))
    assert np.all(after == min(before * MAX_GAMMA_CHANGE, MAX_GAMMA))
