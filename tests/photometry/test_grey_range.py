"""Black and white levels inside the scale: found in histograms, and corrected in observations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.observations import Observations
from ospc.photometry.grey_range import FULL_RANGE, VIDEO_RANGE, GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.recording import Frame
from workers import preprocessor

RANGES = st.builds(GreyRange, st.floats(0, 0.2), st.floats(0.6, 1))
NOTHING = type("Exposures", (), {"log_exposure_of": lambda self, frames: np.zeros(len(frames))})()


def observed(grey):
    """Return points of two equal frames with these grey levels, each covering an equal share of the frame."""
    powers = np.append(np.mean(np.asarray(grey)[:, None] ** np.arange(6), axis=0), 0.1)
    place = np.zeros((len(grey), 2))
    moments = {f"frame_moments{i}": powers[1:] for i in (0, 1)} | {
        f"surround_moments{i}": 0.5 * powers for i in (0, 1)
    }
    return Observations.of_pairs(grey, grey, place, place, 0, 1, **moments).with_exposures(NOTHING)


@given(RANGES, st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_stretching_undoes_the_range(grey_range, levels):
    grey = grey_range.grey(levels)
    np.testing.assert_allclose(grey_range.level(grey), levels, atol=1e-12)
    expected = np.append(np.mean(np.asarray(levels)[:, None] ** np.arange(6), axis=0), 0.1)
    found = observed(np.clip(grey, 0, 1)).stretched(grey_range)
    if len(found):
        np.testing.assert_allclose(found.frame_moments[0], expected[1:], atol=1e-5)
        np.testing.assert_allclose(found.surround_moments[0], np.tile(0.5 * expected, (2, 1)), atol=1e-5)
        found.check()


def test_what_is_clipped_is_left_out_and_the_full_range_changes_nothing():
    grey = np.array([16, 17.5, 100, 233, 235]) / 255
    observations = observed(grey)
    assert observations.stretched(FULL_RANGE) is observations
    np.testing.assert_allclose(observations.stretched(VIDEO_RANGE).grey[::2], VIDEO_RANGE.level(grey[1:4]))


def test_unknown_moments_stay_unknown():
    place = np.zeros((3, 2))
    grey = np.array([0.2, 0.5, 0.8])
    found = Observations.of_pairs(grey, grey, place, place, 0, 1).with_exposures(NOTHING).stretched(VIDEO_RANGE)
    assert not found.frame_moments.any()
    assert not found.surround_moments.any()


def test_noise_is_stretched_too():
    noise = NoiseModel(1e-5, 2e-5)
    level = np.linspace(0, 1, 50)
    expected = noise.variance(VIDEO_RANGE.grey(level)) / VIDEO_RANGE.span**2
    np.testing.assert_allclose(VIDEO_RANGE.stretched_noise(noise).variance(level), expected, rtol=1e-3)
    assert FULL_RANGE.stretched_noise(noise) is noise


def test_the_grey_levels_with_measured_noise_are_stretched_too():
    noise = NoiseModel(1e-5, 2e-5, measured=(0.0, 0.5))
    assert VIDEO_RANGE.stretched_noise(noise).measured == (0.0, float(VIDEO_RANGE.level(0.5)))


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0, 255, FULL_RANGE),
        (16, 235, VIDEO_RANGE),
        (20, 255, GreyRange(20 / 255, 1.0)),
        (0, 240, GreyRange(0.0, 240 / 255)),
        (70, 255, FULL_RANGE),
    ],
)
def test_the_grey_range_ends_where_grey_values_accumulate(low, high, expected):
    random = np.random.default_rng(0)
    statistics = PixelStatistics()
    preprocess = preprocessor()
    for i in range(3):
        image = np.clip(random.normal(128, 90, (120, 160)), low, high).astype(np.uint8)
        frame = Frame.of_array(image, 1.0, index=i)
        statistics.observe(frame, preprocess.thumbnail(frame))
    assert statistics.grey_range == expected


def test_an_end_that_hardly_any_value_reaches_is_none():
    random = np.random.default_rng(0)
    image = np.clip(random.normal(128, 25, (240, 320)), 0, 255).astype(np.uint8)
    statistics = PixelStatistics()
    frame = Frame.of_array(image, 1.0, index=0)
    statistics.observe(frame, preprocessor().thumbnail(frame))
    assert statistics.grey_range == FULL_RANGE


def test_a_limited_range_is_stated_in_the_grey_values_of_the_camera() -> None:
    limited = GreyRange(16 / 255, 235 / 255)
    low, high = limited.note(255).split("; ")
    assert low == "hardly any grey value is below 16 of 255, which is taken for black"
    assert high == "hardly any grey value is above 235 of 255, which is taken for white"
    assert "below 257 of 4095" in limited.note(4095)
    assert "above 3774 of 4095" in limited.note(4095)
    assert GreyRange(white=0.5).note(4095) == "hardly any grey value is above 2048 of 4095, which is taken for white"
    assert not FULL_RANGE.note(4095)
