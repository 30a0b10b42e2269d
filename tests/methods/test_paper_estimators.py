"""The paper's estimators against independent solvers, and exact on undisturbed data."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import least_squares, linprog, minimize

from ospc.methods.paper import (
    Correspondences,
    Estimates,
    disagreement,
    estimate_ratios,
    in_order,
    increases,
    irradiance_ratios,
    polynomial_response,
    response_rows,
    solve_kkt,
    solve_nonnegative,
    solve_response,
    solve_vignette,
    solver_weights,
    standard_error,
    vignette_rows,
)
from ospc.numerics.robust import robust_scale
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette

SIZE = (640, 480)
seeds = st.integers(0, 2**32 - 1)
V = (-0.4, 0.08, -0.12)
TUNING = 1.345


def inverse_of(coefficients, irradiance):
    """Return the grey level at which the quadratic c₁M + c₂M² equals ``irradiance``."""
    c1, c2 = coefficients
    return 2 * irradiance / (c1 + np.sqrt(c1**2 + 4 * c2 * irradiance))


def pairs_of(seed, *, c=(0.4, 0.6), v=(0.0, 0.0, 0.0), count=300, ratio=None, noise=0.0):
    """Return correspondences of a camera with g = c₁M + c₂M² and a polynomial vignette, and the exposure ratio."""
    random = np.random.default_rng(seed)
    k = ratio or float(np.exp(random.uniform(0.1, 0.8) * random.choice([-1, 1])))
    vignette = PolynomialVignette(SIZE, v)
    points = random.uniform(0, 1, (2, count, 2)) * (np.array(SIZE) - 1)
    light = random.uniform(0.03, 0.95, count) / max(k, 1)
    grey = [inverse_of(c, e * vignette.at(p) * light) for e, p in zip((k, 1.0), points, strict=True)]
    grey = [g + random.normal(0, noise, count) for g in grey]
    return Correspondences((0, 1), SIZE, *points, *grey), k


def gram_of(sample, degree=2):
    rows = response_rows(*sample, degree)
    return rows.T @ rows


def constrained(gram, free):
    """Minimise cᵀGc with Σc = 1 over the coefficients ``free``, all others zero, by eliminating the last."""
    *others, last = free
    basis = np.zeros((len(gram), len(others)))
    basis[others, np.arange(len(others))] = 1
    basis[last] = -1
    start = np.zeros(len(gram))
    start[last] = 1
    if others:
        start = start - basis @ np.linalg.solve(basis.T @ gram @ basis, basis.T @ gram @ start)
    return start


# Response


@given(seeds, st.integers(2, 4))
def test_rows_vanish_for_the_true_polynomial(seed, degree):
    pairs, ratio = pairs_of(seed)
    rows = response_rows(pairs, ratio, degree)
    assert rows.shape == (len(pairs), degree + 1)
    np.testing.assert_allclose(rows[:, 0], 1 - ratio)
    truth = np.zeros(degree + 1)
    truth[1:3] = 0.4, 0.6
    np.testing.assert_allclose(rows @ truth, 0, atol=1e-12)


@given(seeds, st.floats(0.05, 1.6))
def test_a_quadratic_is_recovered_exactly_without_noise(seed, c1):
    pairs = pairs_of(seed, c=(c1, 1 - c1))
    np.testing.assert_allclose(solve_kkt(gram_of(pairs)), [0, c1, 1 - c1], atol=1e-7)
    for positivity in ("never", "when needed"):
        np.testing.assert_allclose(solve_response(gram_of(pairs), positivity), [0, c1, 1 - c1], atol=1e-7)
    if 0 < c1 < 1:
        np.testing.assert_allclose(solve_response(gram_of(pairs), "always"), [0, c1, 1 - c1], atol=1e-6)


@given(seeds, st.integers(1, 4), st.floats(0.001, 0.05))
def test_the_kkt_solution_is_that_of_the_eliminated_problem(seed, degree, noise):
    gram = gram_of(pairs_of(seed, noise=noise), degree)
    found = solve_kkt(gram)
    assert found[0] == pytest.approx(0, abs=1e-9)
    assert found.sum() == pytest.approx(1, abs=1e-9)
    expected = constrained(gram, range(1, degree + 1))
    assert found @ gram @ found == pytest.approx(expected @ gram @ expected, rel=1e-6)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("degree", [2, 3])
def test_the_kkt_solution_is_that_of_a_general_solver(degree):
    gram = gram_of(pairs_of(7, noise=0.02), degree)
    gram /= np.trace(gram)
    found = minimize(
        lambda c: c @ gram @ c,
        np.full(degree + 1, 1 / (degree + 1)),
        jac=lambda c: 2 * gram @ c,
        method="SLSQP",
        constraints=[{"type": "eq", "fun": lambda c: c.sum() - 1}, {"type": "eq", "fun": lambda c: c[0]}],
        options={"ftol": 1e-15, "maxiter": 500},
    )
    np.testing.assert_allclose(solve_kkt(gram), found.x, atol=1e-4)


@given(seeds, st.integers(1, 4), st.floats(0.01, 0.3))
def test_the_nonnegative_solution_is_the_best_of_all_active_sets(seed, degree, noise):
    gram = gram_of(pairs_of(seed, noise=noise, ratio=1.1), degree)
    found = solve_nonnegative(gram)
    assert np.all(found >= 0)
    assert found[0] == 0
    assert found.sum() == pytest.approx(1, abs=1e-12)
    sets = (s for n in range(1, degree + 1) for s in combinations(range(1, degree + 1), n))
    candidates = (constrained(gram, s) for s in sets)
    best = min(c @ gram @ c for c in candidates if np.all(c >= -1e-12))
    assert found @ gram @ found == pytest.approx(best, rel=1e-5)


def test_a_solution_that_falls_is_constrained_only_if_that_is_allowed():
    # With weak contrast, noise bends the solution down towards white.
    random = np.random.default_rng(0)
    rows = np.stack([np.full(50, -0.1), random.normal(0, 0.1, 50), random.normal(0, 0.1, 50)], axis=1)
    gram = rows.T @ rows + 10 * np.outer([0, 2, 1], [0, 2, 1])
    falling = solve_kkt(gram)
    assert not increases(falling)
    assert solve_response(gram, "never") is None
    np.testing.assert_array_equal(solve_response(gram, "when needed"), solve_nonnegative(gram))
    np.testing.assert_array_equal(solve_response(gram, "always"), solve_nonnegative(gram))


@given(st.floats(-3, 3))
def test_a_quadratic_increases_if_its_slope_is_positive_at_both_ends(c1):
    assume(min(abs(c1), abs(2 - c1)) > 0.01)
    assert increases(np.array([0, c1, 1 - c1])) == (0 < c1 < 2)


@given(st.floats(0.01, 1.99))
def test_the_response_of_a_polynomial_is_the_polynomial(c1):
    coefficients = np.array([0, c1, 1 - c1])
    response = polynomial_response(coefficients, np.array([coefficients] * 3), (0.1, 0.9))
    grey = np.arange(256) / 255
    np.testing.assert_allclose(response.resampled(256), c1 * grey + (1 - c1) * grey**2, atol=1e-12)
    assert response.model == {"name": "polynomial", "coefficients": coefficients.tolist()}
    assert response.support == (0.1, 0.9)
    np.testing.assert_allclose(response.inverse_sigma, 0, atol=1e-12)  # all estimates agree


# Vignette


def noisy_rows(seed, noise=0.01, outliers=0.0, count=400):
    pairs, ratio = pairs_of(seed, v=V, noise=noise, count=count)
    pairs = pairs.select((pairs.grey0 > 0.01) & (pairs.grey1 > 0.01))
    rows, target = vignette_rows(pairs, ratio, polynomial_response(np.array([0, 0.4, 0.6])))
    astray = np.random.default_rng(seed + 1).random(len(target)) < outliers
    return rows, np.where(astray, target + 1.5, target)


@pytest.mark.parametrize("solver", ["l2", "l1", "m-estimator"])
@given(seed=seeds)
def test_every_solver_is_exact_without_noise(solver, seed):
    quadratic = np.polynomial.polynomial.polyval(np.linspace(0, 1, 4097), [0, 0.4, 0.6])
    rows, target = vignette_rows(*pairs_of(seed, v=V), Response.from_values(quadratic))
    # The remaining error comes from interpolating the response between its levels.
    np.testing.assert_allclose(solve_vignette(rows, target, solver, TUNING), V, atol=2e-4)


@given(seeds)
def test_plain_least_squares_is_the_normal_equations(seed):
    rows, target = noisy_rows(seed)
    expected = np.linalg.solve(rows.T @ rows, rows.T @ target)
    np.testing.assert_allclose(solve_vignette(rows, target, "l2", TUNING), expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_least_absolute_deviations_are_those_of_linear_programming(seed):
    rows, target = noisy_rows(seed, outliers=0.1)
    n, p = rows.shape
    # Minimise Σt over (x, t) subject to −t ≤ rows·x − target ≤ t.
    programme = linprog(
        np.concatenate([np.zeros(p), np.ones(n)]),
        A_ub=np.block([[rows, -np.eye(n)], [-rows, -np.eye(n)]]),
        b_ub=np.concatenate([target, -target]),
        bounds=[(None, None)] * p + [(0, None)] * n,
    )
    found = solve_vignette(rows, target, "l1", TUNING)
    assert np.abs(rows @ found - target).sum() == pytest.approx(programme.fun, rel=1e-4)
    # The minimum is flat: the curves agree better than their coefficients.
    profiles = [PolynomialVignette(SIZE, tuple(v)).profile(np.linspace(0, 1, 11)) for v in (found, programme.x[:p])]
    np.testing.assert_allclose(*profiles, atol=0.005)


@pytest.mark.parametrize("seed", range(5))
def test_hubers_estimate_is_that_of_a_general_solver_at_its_own_scale(seed):
    rows, target = noisy_rows(seed, outliers=0.1)
    found = solve_vignette(rows, target, "m-estimator", TUNING)
    threshold = TUNING * robust_scale(rows @ found - target)
    reference = least_squares(
        lambda x: rows @ x - target, np.zeros(3), jac=lambda _: rows, loss="huber", f_scale=threshold, xtol=1e-15
    )
    np.testing.assert_allclose(found, reference.x, atol=1e-5)


def test_robust_solvers_tolerate_outliers_that_break_least_squares():
    rows, target = noisy_rows(3, noise=0.002, outliers=0.1, count=2000)
    profile = {
        name: PolynomialVignette(SIZE, tuple(solve_vignette(rows, target, name, TUNING))).profile(1.0)
        for name in ("l2", "l1", "m-estimator")
    }
    error = {name: abs(value - (1 + sum(V))) for name, value in profile.items()}
    assert error["l2"] > 0.05
    assert error["l1"] < 0.01
    assert error["m-estimator"] < 0.02


@given(seeds, st.floats(0.1, 10))
def test_weights_of_the_m_estimator_are_one_inside_and_fall_outside(seed, scale):
    residuals = np.random.default_rng(seed).normal(0, scale, 101)
    weights = solver_weights("m-estimator", residuals, TUNING)
    threshold = TUNING * robust_scale(residuals)
    np.testing.assert_allclose(weights * np.abs(residuals), np.minimum(np.abs(residuals), threshold), rtol=1e-9)


def test_the_robust_scale_of_normal_residuals_is_their_standard_deviation():
    assert robust_scale(np.random.default_rng(0).normal(0, 3.0, 100_001)) == pytest.approx(3.0, rel=0.02)
    assert robust_scale(np.empty(0)) == 0


def test_a_perfect_fit_needs_no_scale():
    rows = np.random.default_rng(0).normal(size=(20, 3))
    for solver in ("l1", "m-estimator"):
        found = solve_vignette(rows, rows @ [1.0, 2.0, 3.0], solver, TUNING)
        np.testing.assert_allclose(found, [1, 2, 3], rtol=1e-9)


# Exposure ratios


@given(seeds)
def test_the_exposure_ratio_is_the_mean_ratio_of_irradiance(seed):
    pairs, ratio = pairs_of(seed, v=V, noise=0.01)
    pairs = pairs.select((pairs.grey0 > 0.05) & (pairs.grey1 > 0.05))
    response, vignette = Response.gamma(2.0, 2049), PolynomialVignette(SIZE, V)

    def v_of(radius):
        return 1 + V[0] * radius**2 + V[1] * radius**4 + V[2] * radius**6

    expected = [
        response.inverse(m0) * v_of(r1) / (response.inverse(m1) * v_of(r0))
        for m0, m1, r0, r1 in zip(pairs.grey0, pairs.grey1, pairs.radius0, pairs.radius1, strict=True)
    ]
    np.testing.assert_allclose(irradiance_ratios(pairs, response, vignette), expected, rtol=1e-9)
    estimated = estimate_ratios([(pairs, ratio)], response, vignette).estimated
    assert estimated == pytest.approx(np.mean(expected), rel=1e-12)


@given(st.lists(seeds, min_size=1, max_size=4))
def test_the_true_camera_predicts_the_true_exposures(many):
    samples = [pairs_of(seed, v=V) for seed in many]
    quadratic = np.polynomial.polynomial.polyval(np.linspace(0, 1, 4097), [0, 0.4, 0.6])
    pairs, k = zip(*samples, strict=True)
    none = pairs[0].select(np.zeros(len(pairs[0]), bool)), k[0]
    ratios = estimate_ratios([none, *samples], Response.from_values(quadratic), PolynomialVignette(SIZE, V))
    np.testing.assert_allclose(ratios.estimated, k, rtol=1e-4)
    np.testing.assert_array_equal(ratios.metadata, k)
    np.testing.assert_array_equal(ratios.samples, [len(p) for p in pairs])
    assert disagreement(ratios) < 1e-4


def test_disagreement_is_the_median_and_infinite_without_pairs():
    k = np.array([0.5, 1.0, 2.0])
    off = ExposureRatios(np.zeros((3, 2), np.int64), k, k * np.exp([0.1, -0.2, 0.3]), np.ones(3, np.int64))
    assert disagreement(off) == pytest.approx(0.2)
    assert disagreement(ExposureRatios.none()) == np.inf
    assert disagreement(estimate_ratios([], Response.gamma(1.0), None)) == np.inf


@given(seeds, st.floats(0.0, 0.3))
def test_matches_that_no_increasing_response_allows_are_dropped(seed, noise):
    pairs, ratio = pairs_of(seed, noise=noise)
    kept = in_order(pairs, ratio)
    brighter = kept.grey0 > kept.grey1 if ratio > 1 else kept.grey0 < kept.grey1
    assert brighter.all()
    assert len(kept) == np.count_nonzero(np.sign(pairs.grey0 - pairs.grey1) == np.sign(ratio - 1))


# Invariances


@given(seeds)
def test_the_order_of_the_samples_does_not_matter(seed):
    pairs, k = pairs_of(seed, v=V, noise=0.01)
    order = np.random.default_rng(seed).permutation(len(pairs))
    shuffled = pairs.select(order)
    np.testing.assert_allclose(solve_kkt(gram_of((shuffled, k))), solve_kkt(gram_of((pairs, k))), atol=1e-9)
    response = Response.gamma(2.0)
    for solver in ("l2", "m-estimator"):
        found = [solve_vignette(*vignette_rows(p, k, response), solver, TUNING) for p in (pairs, shuffled)]
        np.testing.assert_allclose(*found, atol=1e-6)
    ratio = estimate_ratios([(pairs, k), (shuffled, k)], response, None).estimated
    assert ratio[0] == pytest.approx(ratio[1], rel=1e-12)


@given(seeds, st.booleans(), st.booleans())
def test_mirroring_the_images_does_not_matter(seed, across, down):
    pairs, k = pairs_of(seed, v=V, noise=0.01)
    sign = np.where([across, down], -1, 1)
    origin = np.where([across, down], np.array(SIZE) - 1, 0)
    mirrored = Correspondences(
        pairs.frames,
        SIZE,
        origin + sign * pairs.points0,
        origin + sign * pairs.points1,
        pairs.grey0,
        pairs.grey1,
    )
    response = Response.gamma(2.0)
    for solver in ("l2", "m-estimator"):
        found = [solve_vignette(*vignette_rows(p, k, response), solver, TUNING) for p in (pairs, mirrored)]
        np.testing.assert_allclose(*found, atol=1e-6)


# Repeatability


@given(seeds, st.integers(2, 8))
def test_estimates_are_averaged_and_their_spread_is_the_standard_error(seed, count):
    curves = np.random.default_rng(seed).normal(size=(count, 5))
    estimates = Estimates(list(curves))
    np.testing.assert_allclose(estimates.mean, curves.mean(axis=0))
    variance = ((curves - curves.mean(axis=0)) ** 2).sum(axis=0) / (count - 1)
    np.testing.assert_allclose(standard_error(curves), np.sqrt(variance / count))


def test_one_estimate_has_no_spread():
    assert standard_error(np.ones((1, 5))) is None
    assert standard_error(np.empty((0, 5))) is None
