"""Merging reduces errors, does not depend on the order, and does not average over contradictions."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.errors import SettingError
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.evaluation.metrics import log_ratio_error, response_shape_rmse, vignette_rmse
from ospc.methods.result import calibration_of
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.response import Response
from ospc.photometry.vignette import half_diagonal_profiles
from ospc.pooling.calibration_summary import summary_of_calibration
from ospc.pooling.pool import Pool, merge
from ospc.pooling.solution import Information, solve_with_chosen_vignette
from ospc.pooling.summary import RESPONSE, VIGNETTE, summary_of
from ospc.research.faults.judging import step_sigma
from ospc.settings import DefaultSettings
from ospc.settings.vignette import VIGNETTE_REACH
from summaries import CAMERA, NOISE, OTHER_LENS, OTHER_RESPONSE, fisheye_inputs_of, inputs_of, summary
from synthetic_observations import SIZE

RECORDINGS = 8


@pytest.fixture(scope="module")
def recordings():
    return [summary(CAMERA, seed) for seed in range(RECORDINGS)]


@pytest.fixture(scope="module")
def merged(recordings):
    return merge(Pool.of(recordings))


@pytest.fixture(scope="module")
def other_lens():
    return summary(OTHER_LENS, 100)


@pytest.fixture(scope="module")
def other_response():
    return summary(OTHER_RESPONSE, 101)


def errors(calibration):
    return np.array(
        [
            response_shape_rmse(calibration.response, CAMERA.response),
            log_ratio_error(calibration.response, CAMERA.response),
            vignette_rmse(calibration.vignette, CAMERA.vignette),
        ]
    )


def as_text(merged):
    return json.dumps(merged.calibration.as_dict())


def test_eight_recordings_have_less_than_half_the_errors_of_their_median(merged):
    alone = [calibration_of(inputs_of(CAMERA, seed), DefaultSettings()) for seed in range(RECORDINGS)]
    median = np.median([errors(calibration) for calibration in alone], axis=0)
    ratios = errors(merged.calibration) / median  # 1 / √8 = 0.35 expected
    assert np.exp(np.log(ratios).mean()) < 0.45
    assert ratios.max() < 0.6
    assert merged.calibration.vignette_sigma[-1] < np.median([c.vignette_sigma[-1] for c in alone])


def test_recordings_of_one_camera_agree(merged):
    assert not merged.agreement.differing
    assert merged.calibration.complete
    assert merged.calibration.counts["recordings"] == RECORDINGS
    assert "based on 8 of 8 recordings" in merged.calibration.verdicts["response"].reason


@pytest.mark.parametrize("count", [2, 4, 8])
def test_recordings_that_scatter_more_than_stated_widen_the_band_of_their_response(recordings, count):
    """Their vignettes scatter as stated."""
    error = 0.02
    exponents = [1.7 + error * (-1) ** seed for seed in range(count)]
    cameras = [replace(CAMERA, response=Response.gamma(exponent, 4097)) for exponent in exponents]
    found = merge(Pool.of(summary(camera, seed) for seed, camera in enumerate(cameras))).calibration
    response = found.response
    sigma = np.interp(0.25, response.levels, response.log_sigma)
    expected = error * np.log(response.reference_grey / 0.25) / np.sqrt(count - 1)
    assert 0.6 < sigma / expected < 1.6
    same = merge(Pool.of(recordings[:count])).calibration
    assert found.vignette_sigma[-1] < 1.25 * same.vignette_sigma[-1]


def test_a_long_and_a_short_recording_that_differ_give_a_band_around_both():
    """The mean is close to the long one, but nothing shows that it is the right one."""
    other = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.46, 0.05, -0.2)))
    short, long = summary(other, 60, groups=20), summary(CAMERA, 0, groups=160)
    found = merge(Pool.of([short, long])).calibration
    for camera in (CAMERA, other):
        error = half_diagonal_profiles(found.vignette, PROFILE_RADII).mean(1)
        error -= half_diagonal_profiles(camera.vignette, PROFILE_RADII).mean(1)
        outer = PROFILE_RADII > 0.5
        assert np.all(np.abs(error[outer]) < 2.5 * found.vignette_sigma[outer])


def test_the_order_makes_no_difference_to_a_single_bit(recordings, merged):
    shuffled = [recordings[n] for n in np.random.default_rng(0).permutation(RECORDINGS)]
    assert as_text(merge(Pool.of(shuffled))) == as_text(merged)
    in_parts = (Pool.of(shuffled[:3]) + Pool.of(shuffled[5:])) + Pool.of(shuffled[2:6])
    assert as_text(merge(in_parts)) == as_text(merged)


def test_one_recording_alone_stays_what_it_was():
    alone = calibration_of(inputs_of(CAMERA, 0), DefaultSettings())
    pooled = merge(Pool.of([summary(CAMERA, 0)])).calibration
    np.testing.assert_allclose(
        np.log(pooled.response.inverse([0.2, 0.8])), np.log(alone.response.inverse([0.2, 0.8])), atol=0.02
    )
    np.testing.assert_allclose(pooled.vignette.image(), alone.vignette.image(), atol=0.01)


@pytest.mark.parametrize("error", [0.0, 0.05])
def test_one_recording_alone_stays_as_uncertain_as_it_was(error):
    inputs = inputs_of(CAMERA, 0)
    suspected = error * inputs.fit.parameters
    fit = replace(inputs.fit, covariance=inputs.fit.covariance + np.outer(suspected, suspected))
    inputs = replace(inputs, fitted=replace(inputs.fitted, fit=fit))
    pooled = merge(Pool.of([summary_of(inputs, "frames", {}, 100)])).calibration
    alone = calibration_of(inputs, DefaultSettings())
    assert step_sigma(pooled) == pytest.approx(step_sigma(alone), rel=0.35)
    assert pooled.vignette_sigma[-1] == pytest.approx(alone.vignette_sigma[-1], rel=0.35)


def test_corners_that_no_recording_shows_are_as_uncertain_as_in_one_alone():
    everywhere = OTHER_LENS.pairs(0, groups=160)
    seen = everywhere.seen_twice(np.linalg.norm(everywhere.position, axis=1) < 0.85)
    fitted = fit_with_chosen_vignette(seen, FitPlan(RESPONSE, VIGNETTE, NOISE, rounds=5))
    own = summary_of(replace(inputs_of(OTHER_LENS, 0), observations=seen, fitted=fitted), "frames", {}, 100)
    pooled = solve_with_chosen_vignette(Information.of([own]))
    radii = np.array([0.5, 0.9, 1.0])
    sigma, own_sigma = (found.vignette_errors(SIZE).sigma(radii) for found in (pooled, fitted.fit))
    np.testing.assert_allclose(sigma, own_sigma, rtol=0.35)
    complete = solve_with_chosen_vignette(Information.of([own, summary(OTHER_LENS, 1)]))
    assert complete.vignette_errors(SIZE).sigma(radii)[2] < 0.5 * sigma[2]


def test_merging_keeps_where_the_image_ends():
    inputs = fisheye_inputs_of(CAMERA, 0, 0.7)
    alone, seen = calibration_of(inputs, DefaultSettings()), summary_of(inputs, "frames", {}, 100)
    # One that is too dark to show the edge of the image circle.
    dark = replace(seen.with_knots(1.0, seen.vignette_reach), key="dark")
    for pool in ([seen], [seen, dark]):
        found = merge(Pool.of(pool)).calibration
        assert found.vignette.limit == pytest.approx(0.7, abs=0.02)
        assert found.verdicts["vignette"].state == alone.verdicts["vignette"].state == "identifiable"
        np.testing.assert_allclose(found.vignette.image(), alone.vignette.image(), atol=0.01)


def test_merging_and_starting_anew_keep_the_knots_of_a_decentred_vignette():
    decentred = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.35, 0.05, -0.2), (0.2, 0.1)))
    seen = [summary(decentred, seed, groups=60, points=80) for seed in range(2)]
    found = merge(Pool.of(seen)).calibration
    known = summary_of_calibration(found, "merged")
    assert [known.vignette_reach, found.vignette.reach] == [seen[0].vignette_reach] * 2 == [1.25, 1.25]
    again = merge(Pool.of([known])).calibration
    corners = [[0, 0], [SIZE[0] - 1, 0], [0, SIZE[1] - 1], [SIZE[0] - 1, SIZE[1] - 1]]
    for vignette in (found.vignette, again.vignette):
        np.testing.assert_allclose(vignette.at(corners), decentred.vignette.at(corners), rtol=0.02)


def test_a_recording_with_fewer_knots_is_merged_in_the_knots_of_the_others():
    decentred = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.35, 0.05, -0.2), (0.2, 0.1)))
    far, near = (summary(decentred, seed, groups=60, points=80) for seed in range(2))
    near = near.with_knots(1.0, VIGNETTE_REACH)
    information = Information.of([far, near])
    assert information.vignette_reach == far.vignette_reach > near.vignette_reach
    without, alone = information.without(near), Information.of([far])
    np.testing.assert_allclose(without.matrix, alone.matrix, atol=1e-6 * np.abs(alone.matrix).max())


@pytest.mark.parametrize("points", [15, 40])
def test_a_region_masked_in_one_recording_is_known_from_another(points):
    masked = summary_of(fisheye_inputs_of(CAMERA, 0, 0.7), "frames", {}, 100)
    found = merge(Pool.of([summary(CAMERA, 1, points=points), masked])).calibration
    assert found.vignette.limit == np.inf
    assert vignette_rmse(found.vignette, CAMERA.vignette) < 0.005


def test_a_ninth_recording_of_another_lens_is_named_and_its_vignette_left_out(recordings, merged, other_lens):
    found = merge(Pool.of([*recordings, other_lens]))
    (difference,) = found.agreement.differing.values()
    assert (difference.name, difference.parts) == ("recording 100", ("vignette",))
    assert "another lens" in difference.text
    assert "the vignette at radius 1.0 differs by +1" in difference.text
    assert "recording 100 left out" in found.calibration.verdicts["vignette"].reason
    assert found.calibration.source["differing"][0]["name"] == "recording 100"
    np.testing.assert_allclose(found.calibration.vignette.image(), merged.calibration.vignette.image(), atol=1e-3)


def test_a_recording_of_another_response_is_left_out_altogether(recordings, merged, other_response):
    found = merge(Pool.of([*recordings, other_response]))
    (difference,) = found.agreement.differing.values()
    assert "response" in difference.parts
    assert "another tone curve" in difference.text
    np.testing.assert_array_equal(found.calibration.response.inverse_table, merged.calibration.response.inverse_table)


def test_wrong_exposures_are_reported(recordings, other_response):
    wrong = replace(other_response, unexplained=0.4)
    (difference,) = merge(Pool.of([*recordings, wrong])).agreement.differing.values()
    assert "its exposures are wrong (40.0% of their changes do not show in the images, usually" in difference.text


def test_a_recording_with_wrong_exposures_is_left_out_of_the_response_too(recordings, merged, other_lens):
    wrong = replace(other_lens, unexplained=0.05)
    found = merge(Pool.of([*recordings, wrong]))
    (difference,) = found.agreement.differing.values()
    assert difference.parts == ("response", "vignette")
    np.testing.assert_array_equal(found.calibration.response.inverse_table, merged.calibration.response.inverse_table)


def test_without_a_majority_the_vignette_is_unknown(recordings, other_lens):
    found = merge(Pool.of([recordings[0], other_lens])).calibration
    assert found.vignette is None
    assert "no majority agrees" in found.verdicts["vignette"].reason
    assert found.response is not None


def test_without_a_majority_on_the_response_nothing_is_used_and_every_verdict_says_why(recordings, other_response):
    found = merge(Pool.of([recordings[0], other_response])).calibration
    assert (found.response, found.vignette) == (None, None)
    response, vignette = found.verdicts["response"], found.verdicts["vignette"]
    assert response.reason == (
        "2 of 2 recordings contradict the others in the response (recording 0, recording 101), and no majority agrees"
    )
    assert (vignette.state, vignette.reason, vignette.remedy) == (response.state, response.reason, response.remedy)
    assert found.advice == (response.remedy,)
    assert (found.counts["recordings"], found.counts["frames"], found.counts["samples"]) == (0, 0, 0)


def test_counts_are_those_of_the_recordings_used(recordings, other_response):
    alone, found = (merge(Pool.of([*recordings[:2], *more])).calibration for more in ((), (other_response,)))
    for part in ("response", "vignette"):
        assert "based on 2 of 3 recordings; recording 101 left out because it differs" in found.verdicts[part].reason
    for count in ("recordings", "frames", "pairs", "samples"):
        assert found.counts[count] == alone.counts[count]
    assert found.counts["differing"] == 1
    assert (alone.source["name"], found.source["name"]) == ("2 recordings", "2 of 3 recordings")


def test_two_cameras_in_one_pool_are_distinguished(recordings, other_lens):
    others = [other_lens, *(summary(OTHER_LENS, seed) for seed in (102, 103))]
    found = merge(Pool.of([*recordings[:5], *others]))
    assert {d.name for d in found.agreement.differing.values()} == {s.name for s in others}


def test_an_empty_pool_is_refused():
    with pytest.raises(SettingError, match="nothing to merge"):
        merge(Pool())
