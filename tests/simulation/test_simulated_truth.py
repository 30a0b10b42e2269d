"""Truth of a simulated recording: exposures, metadata, light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ospc.simulation import SimulationSettings, frames, irradiances, truth
from ospc.simulation.settings import NOISE_PRESETS

SMALL = SimulationSettings(size=(160, 120), frames=24, exposure="cycle", motion="static")


@pytest.fixture(scope="module")
def default_truth():
    return truth(SimulationSettings(size=(160, 120)))


def test_default_exposures_change_more_than_twofold_and_gently(default_truth):
    exposures = default_truth.exposures_ms
    assert exposures.max() / exposures.min() > 2
    assert np.abs(np.diff(np.log(exposures))).max() <= default_truth.settings.auto_rate + 1e-12
    assert exposures.min() >= default_truth.settings.exposure_min_ms
    assert exposures.max() <= default_truth.settings.exposure_max_ms + 1e-9


def test_default_metadata_are_true(default_truth):
    np.testing.assert_array_equal(default_truth.metadata_exposures_ms, default_truth.exposures_ms)
    assert np.all(default_truth.gains == 1)
    assert np.all(default_truth.light == 1)
    np.testing.assert_allclose(np.diff(default_truth.stamps_s), 1 / 20)


def test_a_default_recording_uses_all_greys(default_truth):
    settings = replace(default_truth.settings, size=(320, 240))
    kept = range(0, 500, 10)
    sampled = replace(
        settings,
        frames=len(kept),
        fps=settings.fps / 10,
        exposure="file",
        exposures_ms=tuple(default_truth.exposures_ms[kept]),
    )
    counts, means = np.zeros(256), []
    for frame in frames(sampled):
        counts += np.bincount(frame.image.ravel(), minlength=256)
        means.append(frame.image.mean())
    assert np.all(counts[5:251] > 0)
    assert counts[255] / counts.sum() < 0.1, "not blown out"
    assert min(means) > 60
    assert max(means) < 160


def test_exposure_control_holds_the_mean_grey():
    settings = SimulationSettings(size=(160, 120), frames=40, motion="static", noise="none")
    means = [frame.image.mean() / 255 for frame in frames(settings)]
    assert np.mean(means) == pytest.approx(settings.auto_target, abs=0.03)
    assert np.ptp(means) < 0.01


@pytest.mark.parametrize("lag", [-2, 0, 1, 3])
def test_lag_shifts_the_metadata_and_not_the_images(lag):
    lagging = replace(SMALL, lag=lag)
    known = truth(lagging)
    np.testing.assert_array_equal(known.exposures_ms, truth(SMALL).exposures_ms)
    for i in range(3, 20):
        assert known.metadata_exposures_ms[i] == known.exposures_ms[i - lag]
    assert np.all(np.isfinite(known.metadata_exposures_ms))
    for one, other in zip(frames(lagging), frames(SMALL), strict=True):
        np.testing.assert_array_equal(one.image, other.image)


def test_frames_carry_the_metadata():
    settings = replace(SMALL, lag=1, metadata_error=0.1)
    known = truth(settings)
    made = list(frames(settings))
    np.testing.assert_array_equal([f.exposure_ms for f in made], known.metadata_exposures_ms)
    np.testing.assert_array_equal([f.stamp_s for f in made], known.stamps_s)
    assert [f.index for f in made] == list(range(24))
    assert {f.max_grey for f in made} == {255}


def test_metadata_errors_have_their_size():
    settings = replace(SMALL, frames=2000, metadata_error=0.05)
    known = truth(settings)
    log = np.log(known.metadata_exposures_ms / known.exposures_ms)
    assert log.std() == pytest.approx(0.05, rel=0.1)
    assert abs(log.mean()) < 0.01


def test_programmes_of_exposure():
    assert np.all(truth(replace(SMALL, exposure="constant", exposure_ms=7.5)).exposures_ms == 7.5)
    cycle = truth(replace(SMALL, exposures_ms=(1.0, 4.0, 2.0))).exposures_ms
    np.testing.assert_array_equal(cycle[:7], [1, 4, 2, 1, 4, 2, 1])
    sweep = truth(replace(SMALL, exposure="sweep", exposure_min_ms=0.5, exposure_max_ms=32)).exposures_ms
    assert (sweep[0], sweep[-1]) == pytest.approx((0.5, 32))
    np.testing.assert_allclose(np.diff(np.log(sweep)), np.log(64) / 23)
    listed = tuple(np.linspace(1, 9, 24))
    np.testing.assert_array_equal(truth(replace(SMALL, exposure="file", exposures_ms=listed)).exposures_ms, listed)


def test_gain_takes_over_where_time_ends():
    settings = replace(SMALL, exposure="auto", exposure_max_ms=6.0, gain_max=16.0)
    known = truth(settings)
    assert np.all(known.times_ms <= 6.0 + 1e-9)
    assert known.gains.max() > 1.2
    np.testing.assert_allclose(known.times_ms * known.gains, known.exposures_ms)
    np.testing.assert_array_equal(known.metadata_exposures_ms, known.exposures_ms)


def test_gain_amplifies_noise():
    base = replace(SMALL, frames=2, exposure="constant", response="linear", bit_depth=16, gain_max=8.0)

    def noise(**values):
        one, other = (frame.image.astype(float) for frame in frames(replace(base, **values)))
        return np.std(one - other)

    assert noise(exposure_ms=2.0, gain=8.0) > 2 * noise(exposure_ms=16.0)


def test_flicker_changes_light_behind_the_metadata():
    settings = replace(SMALL, exposure="constant", flicker=0.2, flicker_hz=1.7)
    known = truth(settings)
    assert np.ptp(known.light) > 0.3
    assert np.ptp(known.metadata_exposures_ms) == 0
    bright = np.array([seen.mean() for seen in irradiances(settings)])
    np.testing.assert_allclose(bright / bright.mean(), known.light / known.light.mean(), rtol=1e-5)


def test_flicker_averages_out_over_whole_periods():
    settings = replace(SMALL, exposure="constant", exposure_ms=20.0, flicker=0.5, flicker_hz=50.0, fps=17.0)
    np.testing.assert_allclose(truth(settings).light, 1, atol=1e-9)


def test_seeds():
    one, other = (truth(SimulationSettings(size=(64, 48), frames=5, seed=seed)) for seed in (0, 1))
    assert np.abs(one.trajectory - other.trajectory).max() > 0.01
    filmed = [
        next(iter(irradiances(replace(SMALL, seed=seed, scene_seed=0, motion="static", frames=1)))) for seed in (0, 1)
    ]
    assert np.abs(filmed[0] - filmed[1]).max() > 0.01


def test_the_dictionary_is_json_and_complete():
    import json

    content = json.loads(json.dumps(truth(SMALL).as_dict(), allow_nan=False))
    assert content["settings"]["seed"] == 0
    assert content["settings"]["full_well_electrons"] == NOISE_PRESETS["low"][0]
    assert content["response"]["model"]["name"] == "gamma"
    assert len(content["response"]["inverse_256"]) == 256
    assert len(content["exposures_ms"]) == len(content["light"]) == 24
