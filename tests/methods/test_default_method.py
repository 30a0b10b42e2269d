"""The default method on simulated recordings: accurate, open about what it cannot determine, and repeatable."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded_in_memory import recorded

from ospc.calibrator import OnlineCalibrator
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.evaluation.metrics import log_ratio_error, response_shape_rmse, vignette_pixel_rmse, vignette_rmse
from ospc.exposures.lag_change import LagChange
from ospc.exposures.used import used_exposures
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import radial_profile
from ospc.recording import Frame
from ospc.settings import DefaultSettings
from ospc.settings.fit import UNSEEN_RESPONSE_CHANGE
from ospc.simulation import SimulationSettings
from ospc.simulation import frames as simulated_frames

QUICK = replace(DefaultSettings(), points_per_pair=120, rounds=5, longest_side_px=160, response_intervals=16)
QUICK_FRAMES = 46


@pytest.fixture(scope="module")
def result(walk, calibrated):
    return calibrated(walk.frames[:90])


@pytest.fixture(scope="module")
def pan():
    return recorded(frames=48, size=(240, 180), seed=31, scene_seed=0)


@pytest.fixture(scope="module")
def quick(walk, calibrated):
    return calibrated(walk.frames[:QUICK_FRAMES], QUICK)


def as_text(calibration):
    return json.dumps(calibration.as_dict(), sort_keys=True)


# Accuracy


def test_a_calibration_equals_that_in_its_file(result, tmp_path):
    assert Calibration.load(result.save(tmp_path / "calibration.json")) == result


def test_response_and_vignette_are_found(result, walk):
    assert result.complete
    assert result.converged
    assert response_shape_rmse(result.response, walk.truth.response) < 0.01
    assert log_ratio_error(result.response, walk.truth.response) < 0.01
    assert vignette_rmse(result.vignette, walk.truth.vignette) < 0.02
    assert {v.state for v in result.verdicts.values()} == {"identifiable"}
    assert "ratios of the exposures" in result.verdicts["response"].reason
    assert "at the corner to ±" in result.verdicts["vignette"].reason
    assert result.advice == result.coverage.gaps(255)


def test_stated_sigmas_cover_the_errors(result, walk):
    low, high = np.log([response.inverse([0.3, 0.7]) for response in (result.response, walk.truth.response)]).T
    assert np.ptp(high - low) < 0.02
    profile, truth = (radial_profile(v) for v in (result.vignette, walk.truth.vignette))
    sigma = np.interp((np.arange(50) + 0.5) / 50, PROFILE_RADII, result.vignette_sigma)
    assert np.mean(np.abs(profile - truth) < 3 * sigma + 0.004) > 0.8
    assert result.vignette_sigma.shape == PROFILE_RADII.shape
    assert result.vignette_sigma[0] < 1e-6
    assert np.all(result.response.inverse_sigma >= 0)
    assert result.response.inverse_sigma[0] == 0


def test_bands_widen_above_the_highest_measured_grey_level(result):
    response = result.response
    levels = np.linspace(0, 1, len(response.log_sigma))
    beyond = levels - response.support[1]
    assert beyond[-1] > 0.01
    inside = (beyond > -0.05) & (beyond <= 0)
    slope = np.polyfit(levels[inside], np.log(response.inverse_table[inside]), 1)[0]
    # The slope is taken at the highest measured level, not over the twentieth below.
    least = 0.9 * UNSEEN_RESPONSE_CHANGE * slope * beyond
    assert np.all(response.log_sigma[beyond > 0] >= least[beyond > 0])
    assert response.log_sigma[beyond <= 0][-1] < least[-1]
    assert response.scale_sigma > least[-1]


def test_exposures_are_predicted(result):
    ratios = result.exposure_ratios
    # The ratios of the first pairs are discarded; some other pairs had nothing to compare.
    assert 0.7 * result.counts["pairs"] < len(ratios.metadata) <= result.counts["pairs"]
    assert abs(ratios.bias) < 0.01
    assert np.median(np.abs(ratios.log_residual)) < 0.02
    assert np.all(ratios.samples > 0)


def test_the_counts_add_up(result):
    assert result.counts["frames"] == 90
    assert result.counts["skipped"] == 0
    assert 60 <= result.counts["pairs"] < 90
    assert result.counts["samples"] > 5000
    assert result.size == (320, 240)
    assert result.max_grey == 255
    assert not result.partial
    assert result.settings["preset"] == "default"
    assert set(result.versions) >= {"ospc", "numpy", "opencv"}


def test_covariances_name_their_parameters(result):
    for part in ("response", "vignette"):
        matrix = np.array(result.covariance[part]["matrix"])
        assert matrix.shape == (len(result.covariance[part]["parameters"]),) * 2
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
        assert np.all(np.diag(matrix) > 0)


def test_a_response_with_knees_noise_and_12_bits_is_found(calibrated):
    made = recorded(
        frames=45, size=(240, 180), response="tum_narrow", vignette="decentred", noise="high", bit_depth=12,
        exposure="sweep", exposure_min_ms=4.0, exposure_max_ms=16.0,
    )  # fmt: skip
    result = calibrated(made.frames)
    assert result.max_grey == 4095
    assert result.response.inverse_table.shape == (4096,)
    assert response_shape_rmse(result.response, made.truth.response) < 0.01
    assert vignette_pixel_rmse(result.vignette, made.truth.vignette) < 0.02


def test_points_at_a_knee_do_not_stay_outliers(calibrated):
    """Auto exposure changes little from frame to frame, so few points are seen on both sides of a knee."""
    grey = np.linspace(0, 1, 4097)
    irradiance = np.interp(grey, [0, 0.307, 0.447, 1], [0, 0.21, 0.25, 1])
    made = recorded(
        frames=69, size=(320, 240), response=Response(irradiance), vignette="none", motion="pan",
        seed=1508,
    )  # fmt: skip
    found, true = (one.response for one in (calibrated(made.frames), made.truth))
    ratio, expected = (np.log(one.inverse(0.507) / one.inverse(0.207)) for one in (found, true))
    assert ratio == pytest.approx(expected, abs=0.004)


def test_a_camera_with_white_at_half_scale_is_calibrated(pan, calibrated):
    dark = [
        Frame.of_array(frame.image // 2, frame.exposure_ms, index=frame.index, stamp_s=frame.stamp_s)
        for frame in pan.frames
    ]
    result = calibrated(dark, QUICK)
    assert {result.verdicts[part].state for part in ("response", "vignette")} <= {"identifiable", "marginal"}
    seen = np.array([0.1, 0.2, 0.3, 0.4])
    found, true = (np.diff(np.log(g)) for g in (result.response.inverse(seen), pan.truth.response.inverse(2 * seen)))
    np.testing.assert_allclose(found, true, atol=0.03)
    assert vignette_rmse(result.vignette, pan.truth.vignette) < 0.03


@pytest.mark.parametrize("white", [235, 248])
def test_a_camera_whose_white_scatters_is_calibrated(white, pan, calibrated):
    random, processed = np.random.default_rng(0), []
    for frame in pan.frames:
        noisy = np.rint(np.minimum(frame.image / 200, 1) * white + random.normal(0, 1, frame.image.shape))
        image = np.clip(noisy, 0, 255).astype(np.uint8)
        processed.append(Frame.of_array(image, frame.exposure_ms, index=frame.index, stamp_s=frame.stamp_s))
    result = calibrated(processed, replace(QUICK, longest_side_px=DefaultSettings().longest_side_px))
    assert any("taken for white" in note for note in result.notes)
    seen = np.array([0.2, 0.4, 0.6, 0.8, 0.95])
    estimate, truth = result.response.inverse(white / 255 * seen), pan.truth.response.inverse(200 / 255 * seen)
    np.testing.assert_allclose(np.diff(np.log(estimate)), np.diff(np.log(truth)), atol=0.015)
    assert vignette_rmse(result.vignette, pan.truth.vignette) < 0.005


# Repeatability


def test_calibrating_in_between_does_not_change_the_result(walk, calibrated, quick):
    asked = calibrated(walk.frames[:QUICK_FRAMES], QUICK, ask_after=(1, 2, 30))
    assert as_text(asked) == as_text(quick)


@pytest.mark.parametrize("factor", [2.0])
def test_a_factor_on_all_exposures_changes_nothing_but_the_exposures(walk, calibrated, quick, factor):
    scaled = calibrated([replace(f, exposure_ms=factor * f.exposure_ms) for f in walk.frames[:QUICK_FRAMES]], QUICK)
    # Rounding may change the number of iterations of a fit by one, with almost no effect on the result.
    change = np.abs(scaled.response.inverse_table - quick.response.inverse_table)
    assert change.max() < 0.2 * quick.response.inverse_sigma.max()
    change = np.abs(scaled.vignette.image() - quick.vignette.image())
    assert change.max() < 0.2 * quick.vignette_sigma.max()
    np.testing.assert_allclose(scaled.exposure_ratios.metadata, quick.exposure_ratios.metadata, rtol=1e-9)
    assert [v.state for v in scaled.verdicts.values()] == [v.state for v in quick.verdicts.values()]


def test_frames_coded_as_changes_of_others_double_the_standard_deviations(walk, calibrated, quick):
    coded = calibrated([replace(frame, inter_coded=True) for frame in walk.frames[:QUICK_FRAMES]], QUICK)
    seen = (PROFILE_RADII > 0.2) & (PROFILE_RADII < 0.75)  # the prior limits the rest
    np.testing.assert_allclose(coded.vignette_sigma[seen], 2 * quick.vignette_sigma[seen], rtol=0.3)
    # The prior counts for more, so the result is not quite the same.
    levels = np.linspace(*quick.response.support, 20)
    found, expected = (np.log(one.response.inverse(levels)) for one in (coded, quick))
    change = found - expected - np.log(coded.response.inverse(quick.response.reference_grey))
    change += np.log(quick.response.inverse(quick.response.reference_grey))
    assert np.all(np.abs(change) < np.interp(levels, quick.response.levels, quick.response.log_sigma) + 1e-3)
    assert "inter-frame compression" in coded.notes[0]


def test_sharp_bends_of_the_response_are_not_taken_for_a_response_that_differs_between_frames(calibrated):
    """At a bend, the error of ln g grows with the exposure ratio of a pair."""
    camera = {"response": "tum_narrow", "vignette": "cos4", "noise": "high", "exposure": "cycle"}
    found = calibrated(simulated_frames(SimulationSettings(size=(200, 150), frames=60, seed=43, **camera)))
    assert not found.warnings


def test_after_a_change_of_the_camera_a_quick_fit_to_what_is_kept_soon_follows(walk):
    """Without one, frames are registered with an unknown vignette, and no other change is detected."""
    calibrator = OnlineCalibrator()
    for frame in walk.frames[:80]:
        calibrator.push(frame)
    calibrator._method = calibrator._method.since(11)
    before = calibrator._method.preview(calibrator._run.exposures.table)
    assert before.fit is None
    assert 32 < before.pairs < 48  # the next power of two is far away
    for frame in walk.frames[80:]:
        calibrator.push(frame)
    assert calibrator.preview().fit is not None


def test_unusable_frames_do_not_affect_the_result(walk, result):
    good = walk.frames[:90]

    def unreadable():
        from ospc.errors import FrameError

        raise FrameError("bad.png: cannot be decoded; copy it again")

    bad = [
        Frame(900, 0.0, 12.0, "bad.png", unreadable),
        replace(good[0], exposure_ms=float("nan")),
        replace(good[0], exposure_ms=-3.0),
        Frame.of_array(np.full((48, 64), 90, np.uint8), 3.0),
    ]
    calibrator = OnlineCalibrator()
    for number, frame in enumerate(good):
        assert calibrator.push(frame)
        if number % 25 == 7:
            assert not calibrator.push(bad[number // 25])
    mixed, clean = calibrator.calibration(), result
    assert (mixed.counts["skipped"], mixed.counts["frames"]) == (4, len(good) + 4)
    assert [v.state for v in mixed.verdicts.values()] == [v.state for v in clean.verdicts.values()]
    ends = np.array([0.25, 0.75])
    sigmas = [np.interp(ends, c.response.levels, c.response.log_sigma) for c in (mixed, clean)]
    np.testing.assert_allclose(*sigmas, rtol=1 / 3, atol=1e-3)
    np.testing.assert_allclose(mixed.vignette_sigma, clean.vignette_sigma, rtol=1 / 3, atol=5e-4)
    levels = np.linspace(0.2, 0.8, 13)
    steps = [np.diff(np.log(c.response.inverse(levels))) for c in (mixed, clean)]
    np.testing.assert_allclose(*steps, atol=0.02)


# Limits of observability


def test_a_constant_exposure_gives_no_response(calibrated):
    result = calibrated(recorded(frames=25, size=(160, 120), exposure="constant").frames)
    assert result.response is None
    assert result.vignette is None
    assert result.verdicts["response"].state == "not identifiable"
    assert result.verdicts["response"].reason.startswith("the exposure hardly changes (10 ms)")
    assert "auto exposure" in result.advice[0]
    assert not result.converged
    assert result.covariance == {}


def test_a_static_camera_gives_no_vignette(calibrated, tmp_path):
    made = recorded(
        frames=24, size=(160, 120), motion="static", exposure="sweep", exposure_min_ms=2.0, exposure_max_ms=20.0
    )
    result = calibrated(made.frames)
    assert result.vignette is None
    assert result.vignette_sigma is None
    assert "vignette" not in result.covariance
    assert result.verdicts["vignette"].state == "not identifiable"
    assert "is stationary" in result.verdicts["vignette"].reason
    assert any("pan" in line for line in result.advice)
    assert response_shape_rmse(result.response, made.truth.response) < 0.01
    assert Calibration.load(result.save(tmp_path / "c.json")).vignette is None


@pytest.mark.parametrize("missing_ms", [0.0, 0.1])
def test_an_exposure_offset_is_found_and_corrected_with_a_static_camera(calibrated, missing_ms):
    made = recorded(
        frames=30, size=(160, 120), motion="static", exposure="cycle", exposures_ms=tuple(np.geomspace(1, 30, 15))
    )
    frames = [replace(f, exposure_ms=f.exposure_ms - missing_ms) for f in made.frames]
    result = calibrated(frames)
    stated_ms, true_ms = (np.array([f.exposure_ms for f in some]) for some in (frames, made.frames))
    np.testing.assert_allclose(used_exposures(result, stated_ms), true_ms, atol=0.01)
    assert log_ratio_error(result.response, made.truth.response) < 0.002
    assert result.verdicts["response"].state == "identifiable"
    assert any("too short" in note for note in result.notes) == (missing_ms > 0)


def test_exposures_of_other_frames_are_detected(walk, calibrated):
    shuffled = np.random.default_rng(0).permutation(QUICK_FRAMES)
    mixed_up = [
        replace(f, exposure_ms=f.exposure_ms * (0.5, 1.0, 2.0, 4.0)[i % 4])
        for f, i in zip(walk.frames[:QUICK_FRAMES], shuffled, strict=True)
    ]
    result = calibrated(mixed_up, QUICK)
    assert result.response is None
    assert "does not show in the images" in result.verdicts["response"].reason
    assert "belongs to its frame" in result.verdicts["response"].remedy


def test_unsteady_light_leads_to_advice_for_steadier_light(walk, calibrated):
    rng = np.random.default_rng(0)
    frames = [replace(f, exposure_ms=f.exposure_ms * np.exp(rng.normal(0, 0.01))) for f in walk.frames[:60]]
    result = calibrated(frames, QUICK)
    for name in ("response", "vignette"):
        assert result.verdicts[name].state != "identifiable"
        assert result.verdicts[name].remedy.startswith(
            "film in steadier light with a fixed white balance, or provide"
        )
        assert result.verdicts[name].remedy in result.advice


def test_the_remedy_of_a_contradiction_is_advised_first(walk, calibrated):
    def tone_mapped(frame):
        grey = np.maximum(frame.image_8_bit.astype(np.float32), 1) / 255
        nearby = cv2.GaussianBlur(grey, (0, 0), 0.1 * grey.shape[1])
        image = np.rint(255 * np.clip(grey * nearby**-0.15, 0, 1)).astype(np.uint8)
        return Frame.of_array(image, frame.exposure_ms, index=frame.index)

    result = calibrated([tone_mapped(frame) for frame in walk.frames[:QUICK_FRAMES]], QUICK)
    assert result.warnings
    assert result.advice[0].startswith("switch off local contrast")


def test_pairs_of_frames_agree_with_a_change_of_the_lag_only_if_it_is_real(walk):
    calibrator = OnlineCalibrator(QUICK)
    for frame in walk.frames[:80]:
        calibrator.push(frame)
    method, table = calibrator._method, calibrator._run.exposures.table
    for later in (1, -1, 2):
        change = LagChange(20, later, proven=True)
        assert not method.agrees_with(change, table)
        assert method.agrees_with(change, replace(table, lag_frames=table.lag_frames - later))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_few_frames_are_too_few(walk, calibrated, count):
    result = calibrated(walk.frames[:count])
    assert result.response is None
    assert result.vignette is None
    unknown = (result.verdicts["response"], result.verdicts["vignette"])
    assert all(v.state == "not identifiable" and v.reason and v.remedy for v in unknown)


# Choice of processed frames


def sampler(slowdown, dense=10**9, longest=10**9):
    return FrameSampler(slowdown, dense, longest, 64, 8)


def processed(sampler, frames):
    """Return the numbers of the processed frames."""
    numbers = []
    for number in range(frames):
        numbers += [number] if sampler.processes_next else []
        sampler.advance()
    return numbers


@settings(max_examples=30)
@given(st.integers(1, 100), st.integers(1, 3000))
def test_frames_are_processed_ever_more_rarely(slowdown, frames):
    numbers = processed(sampler(slowdown), frames)
    expected = np.cumsum([0, *(1 + count // slowdown for count in range(frames))])
    np.testing.assert_array_equal(numbers, expected[expected < frames])
    # The work grows with the square root of a recording's length.
    assert len(numbers) <= slowdown + np.sqrt(2 * slowdown * frames)


@settings(max_examples=30)
@given(st.integers(1, 100), st.integers(1, 300), st.integers(1, 50), st.integers(1, 3000), st.integers(1, 64))
def test_pauses_grow_faster_up_to_a_limit_and_are_foreseen(slowdown, dense, longest, frames, ahead):
    limited = sampler(slowdown, dense, longest)
    numbers = processed(limited, frames)
    at_longest = -(-frames // (longest + 1))
    assert len(numbers) <= max(len(processed(sampler(slowdown), frames)), at_longest + dense + slowdown)
    assert max(np.diff(numbers), default=0) <= longest + 1
    foreseen = [limited.at(frames + place).compares_next for place in range(ahead)]
    happened = []
    for _ in range(ahead):
        happened.append(limited.compares_next)
        limited.advance()
    assert foreseen == happened


def test_frames_that_could_not_be_processed_delay_nothing():
    one = sampler(1)
    one.skip()
    assert one.processes_next
    one.advance()
    one.advance()
    assert not one.processes_next
    one.skip()
    assert one.processes_next


def test_a_long_recording_costs_a_fraction_of_its_frames():
    def share(frames):
        return len(processed(DefaultSettings().sampler(), frames)) / frames

    assert share(500) >= 0.3
    assert share(10_000) < 0.08
