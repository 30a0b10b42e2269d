"""Exposure ratios of pairs of frames, and their sigmas."""

from dataclasses import replace

import numpy as np

from ospc.estimation.effects import Effects
from ospc.estimation.maximum_likelihood import fit_model
from ospc.estimation.model import Model
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.methods.exposure_ratios import exposure_ratios
from ospc.photometry.response import Response
from synthetic_observations import ROUNDS, Camera

CAMERA = Camera(Response.gamma(2.2, 256), outliers=0.01)


def ratios_of_other_pairs(seed: int):
    """Fit one set of pairs, and return the exposure ratios of other pairs from the same camera."""
    model = Model(ResponseBasis(32), VignetteBasis(3), Effects())
    fit = fit_model(model, None, CAMERA.pairs(2 * seed), ROUNDS)
    return fit, exposure_ratios(fit, CAMERA.pairs(2 * seed + 1))


def test_stated_deviations_hold_for_pairs_that_were_not_used():
    found = [ratios_of_other_pairs(seed)[1] for seed in range(5)]
    sigmas = np.abs(np.concatenate([one.log_residual / one.log_sigma for one in found]))
    assert 0.6 < np.mean(sigmas < 1) < 0.85
    assert np.mean(sigmas < 2) > 0.92


def test_stated_deviations_hold_if_neighbouring_points_have_errors_in_common():
    random = np.random.default_rng(0)
    sigmas = []
    for seed in range(4):
        fit, _ = ratios_of_other_pairs(seed)
        seen = CAMERA.pairs(2 * seed + 1, points=400)
        later = seen.starts + 1
        patch = np.floor(8 * (seen.position[later] + 1)).astype(int)
        number = np.ravel_multi_index((seen.group[later], *patch.T), (seen.group.max() + 1, 16, 16))
        grey = seen.grey.copy()
        grey[later] *= np.exp(random.normal(0, 0.01, number.max() + 1))[number]
        found = exposure_ratios(fit, replace(seen, grey=grey))
        sigmas.append(np.abs(found.log_residual) / found.log_sigma)
    assert 0.6 < np.mean(np.concatenate(sigmas) < 1) < 0.85
    assert np.mean(np.concatenate(sigmas) < 2) > 0.88


def test_a_pair_whose_points_disagree_is_not_known_the_better_for_being_many():
    fit, right = ratios_of_other_pairs(0)
    seen = CAMERA.pairs(1)
    chosen = np.flatnonzero(seen.group == 20)
    grey = seen.grey.copy()
    grey[chosen[1::2]] = np.random.default_rng(0).permutation(grey[chosen[1::2]])
    wrong = exposure_ratios(fit, replace(seen, grey=grey))
    assert wrong.log_sigma[20] > 20 * right.log_sigma[20]
    np.testing.assert_allclose(np.delete(wrong.log_sigma, 20), np.delete(right.log_sigma, 20))
