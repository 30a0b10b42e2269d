"""Latent gains of frames, checked against known gains."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.frame_gains import FrameGains, gain_sigma
from ospc.settings.residuals import GAIN_MEMORIES, PAIRS_PER_GAIN_BLOCK

DISTANCE_FRAMES = 5
"""Frames between the two frames of a pair."""

CHANCE = 0.003
"""Standard deviation of the mean residual of a pair due to noise."""

NONE = (0.0,) * (1 + len(GAIN_MEMORIES))


def frames_of_pairs(pairs: int) -> IntArray:
    """Return pairs as in a recording: every second frame with the one five frames later."""
    first = 2 * np.arange(pairs)
    return np.stack([first, first + DISTANCE_FRAMES], axis=1)


def seen(gains: FloatArray, frames: IntArray, seed: int = 0) -> FloatArray:
    """Simulate mean residuals of pairs of frames with known gains."""
    chance = CHANCE * np.random.default_rng([seed, 1]).standard_normal(len(frames))
    return np.asarray(gains[frames[:, 0]] - gains[frames[:, 1]] + chance)


def fitted(gains: FloatArray, frames: IntArray, seed: int = 0) -> FrameGains:
    """Fit the variances of the gains to simulated mean residuals."""
    by_chance, mean = np.full(len(frames), CHANCE**2), seen(gains, frames, seed)
    found = FrameGains(frames, by_chance, mean)
    found = FrameGains(frames, by_chance, mean, found.significant_variances)
    for _ in range(12):
        found = FrameGains(frames, by_chance, mean, found.refitted_variances)
    return found


def covariance(gains: FrameGains) -> FloatArray:
    """Return the covariance of the mean residuals that the gains imply."""
    inverse_root = gains.whitened(np.eye(len(gains.mean)), 1.0)
    return np.asarray(np.linalg.inv(inverse_root.T @ inverse_root))


def slow(frames: int, memory: float, seed: int) -> FloatArray:
    """Simulate gains of standard deviation 1 that change smoothly over ``memory`` frames."""
    decay = np.exp(-np.sqrt(3) / memory)
    noise = np.random.default_rng(seed).standard_normal(frames + 20 * int(memory))
    number = np.arange(len(noise))
    # Each gain is twice the one before, less the one before that, both damped, plus noise.
    gains = np.convolve(noise, (number + 1) * decay**number)[len(noise) - frames : len(noise)]
    return np.asarray(gains / np.std(gains))


def test_gains_are_found_if_most_pairs_have_few_points() -> None:
    random, frames, sigma = np.random.default_rng(0), frames_of_pairs(400), 0.003
    gains = sigma * random.standard_normal(2 * 400 + DISTANCE_FRAMES)
    by_chance = np.where(np.arange(400) % 5 < 2, 1e-4, 0.02) ** 2
    mean = gains[frames[:, 0]] - gains[frames[:, 1]] + np.sqrt(by_chance) * random.standard_normal(400)
    variances = FrameGains(frames, by_chance, mean).significant_variances
    for _ in range(15):
        variances = FrameGains(frames, by_chance, mean, variances).refitted_variances
    assert gain_sigma(variances, frames) == pytest.approx(np.sqrt(2) * sigma, rel=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_the_scale_of_independent_gains_is_found(seed: int) -> None:
    frames = frames_of_pairs(200)
    gains = 0.02 * np.random.default_rng(seed).standard_normal(frames.max() + 1)
    found = fitted(gains, frames, seed)
    assert gain_sigma(found.variances, frames) == pytest.approx(0.02 * np.sqrt(2), rel=0.15)
    assert np.sqrt(found.variances[0]) == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize(("memory", "error"), [(8.0, 1.1), (40.0, 0.9)])
def test_slow_gains_are_estimated_from_pairs(memory: float, error: float) -> None:
    frames = frames_of_pairs(200)
    gains = 0.1 * slow(int(frames.max()) + 1, memory, 0)
    found = fitted(gains, frames)
    apart = gains[DISTANCE_FRAMES:] - gains[:-DISTANCE_FRAMES]
    assert gain_sigma(found.variances, frames) == pytest.approx(np.std(apart), rel=0.25)
    first, second = found.of_ends
    true = gains[frames[:, 0]] - gains[frames[:, 1]]
    assert np.std(first - second - true) < error * CHANCE
    assert found.variances[0] < 0.01 * np.var(true)


def test_means_are_as_probable_as_their_covariance_says() -> None:
    frames = frames_of_pairs(200)
    for seed, gains in enumerate([0.02 * np.random.default_rng(9).standard_normal(700), 0.1 * slow(700, 25.0, 3)]):
        found = fitted(gains, frames, seed)
        whitened = found.whitened(found.mean[:, None], 1.0)
        assert np.var(whitened) == pytest.approx(1, rel=0.2)
        assert abs(np.corrcoef(whitened[1:, 0], whitened[:-1, 0])[0, 1]) < 0.2


def test_an_exceptional_pair_counts_less_and_changes_no_other() -> None:
    frames = frames_of_pairs(200)
    gains = 0.01 * np.random.default_rng(0).standard_normal(frames.max() + 1)
    usual = fitted(gains, frames)
    mean = usual.mean.copy()
    mean[100] += 0.5
    found = FrameGains(frames, usual.by_chance, mean, usual.variances)
    before, after = (np.diag(covariance(each)) for each in (usual, found))
    assert after[100] > 20 * before[100]
    assert np.median(after / before) == pytest.approx(1, abs=0.02)
    others = np.abs(np.arange(200) - 100) > 5
    np.testing.assert_allclose(found.of_ends[:, others], usual.of_ends[:, others], atol=0.005)


@pytest.mark.parametrize("seed", range(5))
def test_chance_is_no_gain(seed: int) -> None:
    frames = frames_of_pairs(150)
    mean = seen(np.zeros(frames.max() + 1), frames, seed)
    assert not FrameGains(frames, np.full(150, CHANCE**2), mean).significant_variances


@settings(max_examples=30, deadline=None)
@given(
    ends=st.lists(st.tuples(st.integers(0, 3000), st.integers(1, 60)), min_size=1, max_size=30),
    kind=st.integers(0, len(GAIN_MEMORIES)),
)
def test_covariances_are_those_of_differences(ends: list[tuple[int, int]], kind: int) -> None:
    frames = np.array([(first, first + apart) for first, apart in ends])
    variances = tuple(float(number == kind) for number in range(1 + len(GAIN_MEMORIES)))
    found = covariance(FrameGains(frames, np.ones(len(ends)), np.zeros(len(ends)), variances))
    assert np.linalg.eigvalsh(found).min() > 1 - 1e-9
    # The difference between two gains has a variance between zero and twice that of one gain.
    assert np.all(np.diag(found) <= 1 + 2 + 1e-9)
    turned = FrameGains(frames[:, ::-1], np.ones(len(ends)), np.zeros(len(ends)), variances)
    np.testing.assert_allclose(covariance(turned), found, atol=1e-12)


def test_long_runs_are_cut_into_blocks() -> None:
    frames = frames_of_pairs(2 * PAIRS_PER_GAIN_BLOCK + 7)
    gains = 0.05 * slow(int(frames.max()) + 1, 30.0, 0)
    found = fitted(gains, frames)
    first, second = found.of_ends
    assert first.shape == (len(frames),)
    assert np.std(first - second - (gains[frames[:, 0]] - gains[frames[:, 1]])) < CHANCE
    far = covariance(found)[:PAIRS_PER_GAIN_BLOCK, PAIRS_PER_GAIN_BLOCK:]
    np.testing.assert_allclose(far, 0, atol=1e-12)


def test_no_gains_have_no_scale() -> None:
    assert gain_sigma((), frames_of_pairs(9)) == 0.0
    assert gain_sigma(NONE, frames_of_pairs(9)) == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_gains_stay_finite_for_absurd_means(seed: int) -> None:
    random = np.random.default_rng(seed)
    frames = frames_of_pairs(40)
    chance = 10.0 ** random.uniform(-9, 6, len(frames))
    means = random.normal(size=len(frames)) * 10.0 ** random.uniform(-2, 16, len(frames))
    assert np.all(np.isfinite(FrameGains(frames, chance, means, (0.1,) * len(NONE)).of_ends))
