"""If the response is curved, the mean of textured pixels is not the grey level of their mean irradiance."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import moment

from ospc.estimation.effects import Effects
from ospc.estimation.latent import LatentModel
from ospc.estimation.maximum_likelihood import fit_model
from ospc.estimation.model import Model
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.evaluation.metrics import log_ratio_error
from ospc.observations import Observations
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from synthetic_observations import ROUNDS

LEVELS = np.linspace(0, 1, 256)
TOE_AND_SHOULDER = Response.from_values(LEVELS**2.2 * (0.35 + 0.65 * LEVELS**3))
NOISE = NoiseModel((0.5 / 255) ** 2, 0.0)
PAIRS, POINTS, PIXELS = 60, 100, 28


class Exposures:
    """Alternating exposures that differ by a factor of up to three."""

    def log_exposure_of(self, frames):
        return np.log(10) - np.where(frames % 2, np.log(3) * (frames // 2 % 6) / 5, 0.0)


def textured(contrast, response):
    """Return points whose pixels vary in proportion to their irradiance."""
    random = np.random.default_rng(3)
    n = PAIRS * POINTS
    frame = 2 * np.repeat(np.arange(PAIRS), POINTS)[:, None] + [0, 1]
    exposure = np.exp(Exposures().log_exposure_of(frame)) / 10
    radiance = np.exp(random.normal(-1.2, 0.7, (n, 1, 1)) + contrast * random.standard_normal((n, 1, PIXELS)))
    pixels = response(radiance * exposure[:, :, None]) + 0.5 / 255 * random.standard_normal((n, 2, PIXELS))
    grey, variance, third = pixels.mean(axis=2), pixels.var(axis=2), moment(pixels, 3, axis=2)
    exposed = np.all((pixels > 0.02) & (pixels < 0.97), axis=(1, 2))
    nowhere = np.zeros((int(exposed.sum()), 2))
    return Observations.of_pairs(
        *grey[exposed].T,
        nowhere,
        nowhere,
        *frame[exposed].T,
        grey_variance0=variance[exposed, 0],
        grey_variance1=variance[exposed, 1],
        grey_third_moment0=third[exposed, 0],
        grey_third_moment1=third[exposed, 1],
    ).with_exposures(Exposures())


def fitted(observations):
    return fit_model(Model(ResponseBasis(32), VignetteBasis(0), Effects()), NOISE, observations, ROUNDS)


def error(observations, response):
    return log_ratio_error(fitted(observations).response(), response)


def test_grey_levels_are_predicted_by_the_exposures_however_strong_the_texture():
    """Both predicted grey levels of a point come from the same radiance, so no measurement noise enters the rows."""
    seen = textured(0.2, TOE_AND_SHOULDER)
    found = fitted(seen)
    share = found.texture_share
    predict = LatentModel(found.response_basis, found.parameters, found.errors, NOISE, share, trusted=True)
    latent = predict(seen, np.zeros(len(seen)), np.ones(len(seen)))
    near = np.repeat(np.maximum.reduceat(np.abs(latent.studentised), seen.starts) < 3, 2)
    error = found.log_response[latent.index] - latent.mean - latent.offset
    grid_step = found.response_basis.grid[1]
    assert np.all(np.abs(error[near]) < latent.log_response_slope[near] * grid_step)


def test_points_without_weight_are_judged_like_the_others():
    """Without a radiance, they would be predicted anywhere and could never get a weight again."""
    seen = textured(0.1, TOE_AND_SHOULDER)
    found = fitted(seen)
    share = found.texture_share
    predict = LatentModel(found.response_basis, found.parameters, found.errors, NOISE, share, trusted=True)
    weight = np.where(seen.group % 2, 0.0, 1.0)
    without, all_weighted = (predict(seen, np.zeros(len(seen)), each) for each in (weight, np.ones(len(seen))))
    np.testing.assert_array_equal(without.studentised, all_weighted.studentised)
    np.testing.assert_array_equal(without.grey, all_weighted.grey)


@pytest.mark.parametrize("contrast", [0.15, 0.2])
def test_texture_is_taken_out(contrast):
    seen = textured(contrast, TOE_AND_SHOULDER)
    unknown = error(replace(seen, grey_variance=np.zeros(len(seen))), TOE_AND_SHOULDER)
    assert error(seen, TOE_AND_SHOULDER) < 0.8 * unknown


def test_without_texture_nothing_changes():
    seen = textured(0.0, TOE_AND_SHOULDER)
    unknown = error(replace(seen, grey_variance=np.zeros(len(seen))), TOE_AND_SHOULDER)
    assert error(seen, TOE_AND_SHOULDER) == pytest.approx(unknown, abs=2e-4)


def test_variance_that_is_no_texture_is_left_alone():
    """Variance proportional to the light at untextured points, as after sharpening, triggers no correction."""
    seen = textured(0.0, TOE_AND_SHOULDER)
    share = np.repeat(0.1 * np.random.default_rng(4).random(len(seen.starts)) ** 2, 2)
    false = replace(seen, grey_variance=seen.grey_variance + share * seen.grey**2)
    assert fitted(false).texture_share < 0.1
    assert error(false, TOE_AND_SHOULDER) == pytest.approx(error(seen, TOE_AND_SHOULDER), abs=2e-4)
