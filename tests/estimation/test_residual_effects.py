"""Parts of the image that a fit does not explain."""

from dataclasses import replace

import numpy as np
import pytest

from ospc.estimation.residual_effects import uneven_vignette, unsteadiness
from ospc.photometry.response import Response
from synthetic_observations import Camera

SEEN = Camera(Response.gamma(2.2, 256)).pairs(0, groups=60, points=300)
SCATTER = 0.005
SIGMA = np.full(len(SEEN), SCATTER)


def residuals(of_corner: float, of_neighbours: float) -> np.ndarray:
    """Return normal residuals with additions in a corner of the image, and in a part of its surroundings."""
    right, below = (SEEN.position / np.abs(SEEN.position).max(axis=0)).T
    corner = (right > 7 / 8) & (below > 5 / 6)
    near = (right > 3 / 4) & (below > 2 / 3) & ~corner
    random = np.random.default_rng(0)
    return random.normal(0, SCATTER, len(right)) + of_corner * corner + of_neighbours * near


def test_residuals_of_chance_show_nothing():
    assert uneven_vignette(residuals(0.0, 0.0), SIGMA, SEEN) == ()


@pytest.mark.parametrize("of_corner", [-0.04, -0.1, 0.1])
def test_a_corner_that_the_fit_rejects_is_not_offset_by_its_surroundings(of_corner: float):
    """The vignette adapts to the corner as far as it can, so the residuals next to it have the opposite sign."""
    limited = 5 * SCATTER * np.sign(of_corner)  # outliers count as little more
    (found,) = uneven_vignette(residuals(of_corner, -limited / 3), SIGMA, SEEN)
    assert found.contradicts
    assert found.value == pytest.approx(2 * of_corner, rel=0.1)


def test_a_part_is_rejected_although_its_residuals_have_both_signs():
    random = np.random.default_rng(1)
    right, below = SEEN.position.T
    part = (np.abs(right - 0.2) < 0.1) & (np.abs(below - 0.2) < 0.1)
    residual = residuals(0.0, 0.0) + part * random.choice([-0.08, 0.0, 0.08], len(right))
    (found,) = uneven_vignette(residual, SIGMA, SEEN)
    assert found.contradicts
    assert abs(found.value) == pytest.approx(0.16, rel=0.1)


def test_a_dark_part_is_not_rejected_because_of_its_noise():
    right, below = SEEN.position.T
    dark = (np.abs(right - 0.2) < 0.1) & (np.abs(below - 0.2) < 0.1)
    noise = np.where(dark, 20 * SCATTER, 1.0 * SCATTER)
    residual = np.random.default_rng(2).normal(0, noise)
    assert uneven_vignette(residual, noise, SEEN) == ()
    assert uneven_vignette(residual, SIGMA, SEEN) != ()


def test_points_that_stay_within_a_part_are_no_evidence_against_it():
    """Where a camera drives to, the scene hardly moves and is fine, so it is often registered wrongly."""
    position = SEEN.position.copy()
    still = np.all(np.abs(position[0::2] - 0.2) < 0.1, axis=1)
    position[1::2][still] = position[0::2][still]
    wrong = np.repeat(still, 2) * np.random.default_rng(3).choice([-0.08, 0.08], len(still)).repeat(2)
    residual = residuals(0.0, 0.0) + wrong * np.tile([1, -1], len(still))
    assert uneven_vignette(residual, SIGMA, replace(SEEN, position=position)) == ()


def test_points_with_large_errors_do_not_make_the_response_unsteady():
    """Where texture is dark and coarse, its correction is wrong in proportion to the exposure ratio."""
    dark = SEEN.grey < 0.3
    sigma = np.where(dark, 20 * SCATTER, SCATTER)
    chance = np.random.default_rng(4).normal(0, SCATTER, len(SEEN) // 2)
    of_pair = chance + 0.05 * np.diff(SEEN.log_exposure.reshape(-1, 2))[:, 0] * dark.reshape(-1, 2).any(axis=1)
    residual = np.stack([-of_pair, of_pair], axis=1).ravel()
    assert unsteadiness(residual, sigma, SEEN) == ()
    assert [found.name for found in unsteadiness(residual, SIGMA, SEEN)] == ["unsteady response"]
