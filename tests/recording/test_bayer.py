"""Bayer mosaics: they are distinguished from grey images, and their green pixels are found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from image_samples import encoded, grey

from ospc.arrays import Image
from ospc.recording import open_recording
from ospc.recording.channel import Channel, Mosaic, find_mosaic
from ospc.recording.image_source import decode_grey
from ospc.recording.options import ReadingOptions


def smooth(seed: int, dtype: type = np.uint16) -> Image:
    """Return a scene with similar neighbouring pixels."""
    noise = np.random.default_rng(seed).random((60, 80)).astype(np.float32)
    scene = cv2.GaussianBlur(noise, (0, 0), 2)
    return (50 + 150 * (scene - scene.min()) / np.ptp(scene)).astype(dtype)


def mosaic(scene: Image, pattern: str, red: float = 0.8, blue: float = 0.4) -> Image:
    """Return the scene behind red, green and blue filters."""
    weights = np.ones((2, 2))
    others = [place for place in np.ndindex(2, 2) if place not in Mosaic(pattern).places(Channel.GREEN)]
    weights[others[0]], weights[others[1]] = red, blue
    return (scene * np.tile(weights, (30, 40))).astype(scene.dtype)


@given(st.sampled_from(Mosaic.GREEN_PATTERNS), st.integers(0, 10_000), st.sampled_from([np.uint8, np.uint16]))
def test_a_mosaic_is_recognised_with_its_green_pixels(pattern: str, seed: int, dtype: type) -> None:
    assert find_mosaic(mosaic(smooth(seed, dtype), pattern)) == Mosaic(pattern)


@given(st.integers(0, 10_000))
def test_grey_scenes_noise_and_blackness_are_no_mosaic(seed: int) -> None:
    assert find_mosaic(smooth(seed)) is None
    assert find_mosaic(grey(seed, (80, 60))) is None
    assert find_mosaic(np.zeros((60, 80), np.uint8)) is None


def test_stripes_of_a_sensor_are_no_mosaic() -> None:
    scene = smooth(0)
    scene[:, ::2] += 20
    assert find_mosaic(scene) is None
    assert find_mosaic(scene.T) is None


def test_odd_sizes_are_no_mosaic() -> None:
    assert find_mosaic(mosaic(smooth(0), ".gg.")[:-1]) is None


@pytest.mark.parametrize("pattern", Mosaic.GREEN_PATTERNS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_green_is_the_mean_of_its_two_pixels_rounded_without_bias(pattern: str, dtype: type) -> None:
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (200, 300), dtype, endpoint=True)
    taken = Mosaic(pattern).of(image, Channel.GREEN)
    both = [image[row::2, column::2].astype(float) for row, column in Mosaic(pattern).places(Channel.GREEN)]
    assert taken.dtype == dtype
    error = taken - np.mean(both, axis=0)
    assert np.abs(error).max() <= 0.5
    assert abs(error.mean()) < 0.01


def test_other_kinds_only_report_a_mosaic(tum_folder: Callable[..., Path]) -> None:
    data = encoded(mosaic(smooth(0, np.uint8), ".gg."))
    recording = open_recording(tum_folder("0 1 1\n", {"0.png": data}))
    assert recording.size == (80, 60)
    assert "look like a Bayer mosaic" in recording.notes[0]


def test_a_mosaic_in_a_png_stays_in_colour_like_that_of_a_raw_file(tum_folder: Callable[..., Path]) -> None:
    stored = mosaic(smooth(0, np.uint8), "rggb")
    options = ReadingOptions(channel=Channel.ALL, bayer=Mosaic("rggb"))
    recording = open_recording(tum_folder("0 1 1\n", {"0.png": encoded(stored)}), options=options)
    (frame,) = recording
    assert recording.size == (40, 30)
    np.testing.assert_array_equal(frame.image, Mosaic("rggb").of(stored, Channel.ALL))
    assert recording.notes[0] == "images are a Bayer mosaic; the colour of each 2×2 block is used"


def test_real_images_of_a_mosaic_and_of_its_green(real_data: Path) -> None:
    for path in real_data.glob("borealhdr_left_raw12/*/*.png"):
        assert find_mosaic(decode_grey(path.read_bytes(), path.name)) == Mosaic(".gg.")
    for path in sorted(real_data.glob("borealhdr_left/images/*.png"))[:6]:
        assert find_mosaic(decode_grey(path.read_bytes(), path.name)) is None
