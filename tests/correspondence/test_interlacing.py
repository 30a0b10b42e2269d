"""Interlaced images are told from others, and their exposures are not relied on."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc import calibrate
from ospc.correspondence.interlacing import row_contrast
from ospc.settings.correspondence import MIN_INTERLACED_CONTRAST
from ospc.simulation import SimulationSettings, frames


def texture(seed, smoothing_px):
    noise = np.random.default_rng(seed).normal(size=(240, 330)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), smoothing_px)
    return 128 + 40 * smooth / smooth.std()


def as_image(grey, max_grey=255):
    values = np.clip(np.rint(grey * (max_grey / 255)), 0, max_grey)
    return values.astype(np.uint8 if max_grey == 255 else np.uint16)


def woven(first, second):
    both = first.copy()
    both[1::2] = second[1::2]
    return both


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 6), st.sampled_from([255, 4095]), st.floats(0, 5))
def test_texture_and_noise_of_rows_are_not_taken_for_interlacing(seed, smoothing_px, max_grey, row_noise):
    rows = np.random.default_rng([seed, 1]).normal(0, row_noise, (240, 1))
    image = as_image(texture(seed, smoothing_px) + rows, max_grey)
    assert 1 / 5 < row_contrast(image, max_grey) < 5


@given(st.integers(0, 2**32 - 1), st.floats(1.5, 6), st.sampled_from([255, 4095]), st.sampled_from([0, 2, 5]))
def test_a_moving_or_brighter_second_field_shows(seed, smoothing_px, max_grey, shift_px):
    grey = texture(seed, smoothing_px)
    later = np.roll(grey, shift_px, axis=1) * (1.3 if shift_px == 0 else 1.0)
    image = as_image(woven(grey, later), max_grey)
    assert row_contrast(image, max_grey) > MIN_INTERLACED_CONTRAST


@given(st.integers(0, 255), st.tuples(st.integers(1, 40), st.integers(1, 40)))
def test_even_and_tiny_images_are_not_interlaced(level, shape):
    assert row_contrast(np.full(shape, level, np.uint8), 255) == 1


@pytest.fixture(scope="module")
def recording():
    return list(frames(SimulationSettings(size=(240, 180), frames=60, seed=3)))


@pytest.mark.parametrize("interlaced", [False, True])
def test_exposures_of_interlaced_images_are_not_relied_on(recording, interlaced):
    if interlaced:
        later = [*recording[1:], recording[-1]]
        recording = [
            replace(frame, load=partial(woven, frame.image, next_one.image))
            for frame, next_one in zip(recording, later, strict=True)
        ]
    found = calibrate(recording)
    assert any("interlaced" in warning for warning in found.warnings) == interlaced
    assert ("interlaced" in found.verdicts["exposures"].reason) == interlaced
    states = {verdict.state for verdict in found.verdicts.values()}
    assert ("identifiable" in states) != interlaced
