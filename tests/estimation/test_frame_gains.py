"""Latent gains of frames, checked against known gains."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.frame_gains import FrameGains, PairEnds, PairMeans, gain_sigmas
from ospc.settings.residuals import GAIN_KINDS, PAIRS_PER_GAIN_BLOCK

DISTANCE_FRAMES = 5
"""Frames between the two frames of a pair."""

CHANCE = 0.003
"""Standard deviation of the mean residual of a pair due to noise."""

NONE = (0.0,) * GAIN_KINDS


def frames_of_pairs(pairs: int) -> IntArray:
    """Return pairs as in a recording: every second frame with the one five frames later."""
    first = 2 * np.arange(pairs)
    return np.stack([first, first + DISTANCE_FRAMES], axis=1)


def ends_of(frames: IntArray) -> PairEnds:
    """Return pairs of frames whose exposures are all different."""
    return PairEnds(frames, 0.1 * np.sin(frames))


def gain_sigma(variances: tuple[float, ...], frames: IntArray) -> float:
    """Return the typical change of the gain between the frames of a pair; exposures do not recur."""
    light, exposures = gain_sigmas(variances, ends_of(frames))
    assert exposures == 0.0
    return light


def seen(gains: FloatArray, frames: IntArray, seed: int = 0) -> FloatArray:
    """Simulate mean residuals of pairs of frames with known gains."""
    chance = CHANCE * np.random.default_rng([seed, 1]).standard_normal(len(frames))
    return np.asarray(gains[frames[:, 0]] - gains[frames[:, 1]] + chance)


def fitted(gains: FloatArray, frames: IntArray, seed: int = 0) -> FrameGains:
    """Fit the variances of the gains to simulated mean residuals."""
    by_chance, mean = np.full(len(frames), CHANCE**2), seen(gains, frames, seed)
    return converged(ends_of(frames), by_chance, mean)


def converged(ends: PairEnds, by_chance: FloatArray, mean: FloatArray) -> FrameGains:
    """Fit the variances of the gains to mean residuals."""
    means = PairMeans(mean, by_chance)
    variances = means.initial_variances
    for _ in range(10):
        variances = FrameGains(ends, means, variances).refitted_variances
    return FrameGains(ends, means, variances)


def covariance(gains: FrameGains) -> FloatArray:
    """Return the covariance of the mean residuals that the gains imply."""
    inverse_root = gains.whitened(np.eye(len(gains.means)), 1.0)
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
    variances = converged(ends_of(frames), by_chance, mean).variances
    assert gain_sigma(variances, frames) == pytest.approx(np.sqrt(2) * sigma, rel=0.2)


@pytest.mark.parametrize("seed", range(3))
def test_the_scale_of_independent_gains_is_found(seed: int) -> None:
    frames = frames_of_pairs(200)
    gains = 0.02 * np.random.default_rng(seed).standard_normal(frames.max() + 1)
    found = fitted(gains, frames, seed)
    assert found.means.most_exceed_chance
    assert gain_sigma(found.variances, frames) == pytest.approx(0.02 * np.sqrt(2), rel=0.15)
    # Gains of single frames and of exposures that do not recur are the same.
    assert np.sqrt(found.variances[0] + found.variances[-1]) == pytest.approx(0.02, rel=0.2)


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
    assert found.variances[0] + found.variances[-1] < 0.01 * np.var(true)


def test_means_are_as_probable_as_their_covariance_says() -> None:
    frames = frames_of_pairs(200)
    for seed, gains in enumerate([0.02 * np.random.default_rng(9).standard_normal(700), 0.1 * slow(700, 25.0, 3)]):
        found = fitted(gains, frames, seed)
        whitened = found.whitened(found.means.mean[:, None], 1.0)
        assert np.var(whitened) == pytest.approx(1, rel=0.2)
        assert abs(np.corrcoef(whitened[1:, 0], whitened[:-1, 0])[0, 1]) < 0.2


def test_an_exceptional_pair_counts_less_and_changes_no_other() -> None:
    frames = frames_of_pairs(200)
    gains = 0.01 * np.random.default_rng(0).standard_normal(frames.max() + 1)
    usual = fitted(gains, frames)
    mean = usual.means.mean.copy()
    mean[100] += 0.5
    found = FrameGains(ends_of(frames), PairMeans(mean, usual.means.by_chance), usual.variances)
    before, after = (np.diag(covariance(each)) for each in (usual, found))
    assert after[100] > 20 * before[100]
    assert np.median(after / before) == pytest.approx(1, abs=0.02)
    others = np.abs(np.arange(200) - 100) > 5
    np.testing.assert_allclose(found.of_ends[:, others], usual.of_ends[:, others], atol=0.005)


@pytest.mark.parametrize("seed", range(3))
def test_errors_of_exposures_that_recur_are_told_from_those_of_frames(seed: int) -> None:
    random, frames = np.random.default_rng(seed), frames_of_pairs(200)
    level = random.integers(12, size=int(frames.max()) + 1)
    ends, errors = PairEnds(frames, level[frames].astype(np.float64)), 0.02 * random.standard_normal(12)
    found = converged(ends, np.full(200, CHANCE**2), seen(errors[level], frames, seed))
    light, of_exposures = gain_sigmas(found.variances, ends)
    assert of_exposures == pytest.approx(np.std(errors), rel=0.4)
    assert light < CHANCE
    # A pair of other frames with these exposures would have the same gains.
    first, second = found.of_ends
    assert np.std(first - second - (errors[level[frames[:, 0]]] - errors[level[frames[:, 1]]])) < 0.5 * CHANCE
    of_frames = converged(ends, np.full(200, CHANCE**2), seen(0.02 * random.standard_normal(len(level)), frames))
    light, of_exposures = gain_sigmas(of_frames.variances, ends)
    assert light == pytest.approx(0.02 * np.sqrt(2), rel=0.2)
    assert of_exposures < 0.01


def test_a_few_pairs_that_are_wrong_by_far_show_gains() -> None:
    """A response that suits the other pairs hides the error of an exposure that hardly any pair has."""
    mean = seen(np.zeros(400), frames_of_pairs(150))
    mean[::15] += 0.04
    found = PairMeans(mean, np.full(150, CHANCE**2))
    assert found.some_exceed_chance
    assert not found.most_exceed_chance
    mean[15::15] -= 0.04  # the rest may be an exceptional pair
    assert not PairMeans(mean, np.full(150, CHANCE**2)).some_exceed_chance


@pytest.mark.parametrize("seed", range(5))
def test_chance_is_no_gain(seed: int) -> None:
    frames = frames_of_pairs(150)
    mean = seen(np.zeros(frames.max() + 1), frames, seed)
    found = PairMeans(mean, np.full(150, CHANCE**2))
    assert not found.most_exceed_chance
    assert not found.some_exceed_chance


@settings(max_examples=30, deadline=None)
@given(
    ends=st.lists(st.tuples(st.integers(0, 3000), st.integers(1, 60)), min_size=1, max_size=30),
    kind=st.integers(0, GAIN_KINDS - 1),
)
def test_covariances_are_those_of_differences(ends: list[tuple[int, int]], kind: int) -> None:
    frames = np.array([(first, first + apart) for first, apart in ends])
    variances = tuple(float(number == kind) for number in range(GAIN_KINDS))
    found = covariance(FrameGains(ends_of(frames), PairMeans(np.zeros(len(ends)), np.ones(len(ends))), variances))
    assert np.linalg.eigvalsh(found).min() > 1 - 1e-9
    # The difference between two gains has a variance between zero and twice that of one gain.
    assert np.all(np.diag(found) <= 1 + 2 + 1e-9)
    turned = FrameGains(ends_of(frames[:, ::-1]), PairMeans(np.zeros(len(ends)), np.ones(len(ends))), variances)
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
    assert gain_sigmas((), ends_of(frames_of_pairs(9))) == (0.0, 0.0)
    assert gain_sigma(NONE, frames_of_pairs(9)) == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_gains_stay_finite_for_absurd_means(seed: int) -> None:
    random = np.random.default_rng(seed)
    frames = frames_of_pairs(40)
    chance = 10.0 ** random.uniform(-9, 6, len(frames))
    means = random.normal(size=len(frames)) * 10.0 ** random.uniform(-2, 16, len(frames))
    assert np.all(np.isfinite(FrameGains(ends_of(frames), PairMeans(means, chance), (0.1,) * len(NONE)).of_ends))
