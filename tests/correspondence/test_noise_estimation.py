"""Pixel noise estimated on images with known noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.noise_estimation import NoiseEstimator
from ospc.exposures.table import ExposureTable
from ospc.recording import Frame
from ospc.settings.sampling import NOISE_BINS

UNKNOWN = ExposureTable.of(np.full(1, np.nan))
"""Exposures from which no gain follows."""


def of_array(image):
    return Frame.of_array(image, 1.0)


def scene(seed=0, texture=0.0):
    """Return a smooth scene covering all grey levels, optionally with edges in four fifths of it."""
    x, y = np.meshgrid(np.linspace(0, 1, 640), np.linspace(0, 1, 480))
    level = 0.5 + 0.43 * np.sin(5 * x + 3 * y + seed)
    edges = np.repeat(np.random.default_rng(seed).random((480, 160)), 4, axis=1) - 0.5
    return level + texture * edges * (x > 0.2)


def measured(read, shot, *, max_grey=255, images=4, texture=0.0, reduction=1):
    estimator, random = NoiseEstimator(max_grey), np.random.default_rng(1)
    for index in range(images):
        level = np.clip(scene(index, texture), 0, 1)[::reduction, ::reduction]
        noisy = level + random.normal(0, 1, level.shape) * np.sqrt(read + shot * level)
        image = np.clip(np.rint(noisy * max_grey), 0, max_grey)
        estimator.observe(of_array(image.astype(np.uint8 if max_grey == 255 else np.uint16)))
    return estimator.model(UNKNOWN)


@pytest.mark.parametrize("max_grey", [255, 4095])
@pytest.mark.parametrize(("read", "shot"), [(2e-5, 1e-4), (1e-4, 0.0), (2e-5, 1e-3)])
def test_known_noise_is_measured(read, shot, max_grey):
    model = measured(read, shot, max_grey=max_grey)
    grey = np.array([0.15, 0.3, 0.5, 0.8])
    quantisation = 1 / 12 / max_grey**2
    np.testing.assert_allclose(model.variance(grey), read + shot * grey + quantisation, rtol=0.15)


def test_small_images_measure_noise_together():
    """An image of 160×120 has only about six blocks per range of grey levels."""
    model = measured(2e-5, 1e-3, images=60, reduction=4)
    grey = np.array([0.15, 0.3, 0.5, 0.8])
    np.testing.assert_allclose(model.variance(grey), 2e-5 + 1e-3 * grey, rtol=0.2)


def test_the_measured_grey_levels_are_known_also_if_neighbours_are_equally_noisy():
    first, last, equal = 4, 11, [1e-5]
    found = [equal if first <= number <= last else [] for number in range(NOISE_BINS)]
    found[8] = [2e-5]
    frames = [[0] * len(variances) for variances in found]
    assert NoiseEstimator(255, found, frames).model(UNKNOWN).measured == (first / NOISE_BINS, (last + 1) / NOISE_BINS)


def test_edges_are_not_taken_for_noise():
    model = measured(2e-5, 1e-4, texture=0.15)
    assert model.variance(0.5) < 2 * (2e-5 + 0.5e-4)


@pytest.mark.parametrize("max_grey", [255, 65535])
def test_noise_is_never_less_than_quantisation(max_grey):
    assert measured(0.0, 0.0, max_grey=max_grey).read_variance >= 1 / 12 / max_grey**2


@given(st.integers(0, 255), st.tuples(st.integers(10, 24), st.integers(10, 24)))
def test_uninformative_images_leave_quantisation_noise(level, shape):
    estimator = NoiseEstimator(255)
    estimator.observe(of_array(np.full(shape, level, np.uint8)))
    model = estimator.model(UNKNOWN)
    assert model.read_variance > 0
    assert model.shot_variance == 0
    assert NoiseEstimator(255).model(UNKNOWN) == model


@given(st.integers(0, 2**32 - 1), st.tuples(st.integers(10, 60), st.integers(10, 60)))
def test_whatever_is_seen_the_variance_is_positive(seed, shape):
    random = np.random.default_rng(seed)
    estimator = NoiseEstimator(255)
    for _ in range(3):
        estimator.observe(of_array((random.random(shape) ** random.uniform(0.1, 8) * 255).astype(np.uint8)))
    assert np.all(estimator.model(UNKNOWN).variance([0.0, 0.5, 1.0]) > 0)


def film(gains, read, shot, seed):
    """Return the estimator after frames whose electrons are amplified by gains."""
    estimator, random = NoiseEstimator(4095), np.random.default_rng(seed)
    for index, gain in enumerate(gains):
        level = scene(index)
        noisy = level + random.normal(0, 1, level.shape) * np.sqrt(read * gain**2 + shot * gain * level)
        estimator.observe(Frame.of_array(np.clip(noisy * 4095, 0, 4095).astype(np.uint16), 1.0, index=index))
    return estimator


@pytest.mark.parametrize("limit_ms", [1.0, 4.0])
@pytest.mark.parametrize(("read", "shot", "power"), [(1e-8, 2e-5, 1.0), (2e-6, 1e-9, 2.0)])
def test_noise_grows_with_the_gain_beyond_the_longest_exposure_time(limit_ms, read, shot, power):
    exposures_ms = np.geomspace(1, 32, 24)
    gains = np.maximum(exposures_ms / limit_ms, 1.0)
    model = film(gains, read, shot, 0).model(ExposureTable.of(np.log(exposures_ms)))
    np.testing.assert_allclose(model.growth(np.log(exposures_ms)), gains**power, rtol=0.3)
    grey = np.array([0.2, 0.5, 0.8])
    np.testing.assert_allclose(model.variance(grey), read + shot * grey + 1 / 12 / 4095**2, rtol=0.25)


@pytest.mark.parametrize("seed", range(3))
def test_without_gain_noise_does_not_depend_on_the_exposure(seed):
    exposures_ms = np.geomspace(1, 32, 24)
    model = film(np.ones(24), 1e-6, 2e-5, seed).model(ExposureTable.of(np.log(exposures_ms)))
    assert np.all(model.growth(np.log(exposures_ms)) == 1)
