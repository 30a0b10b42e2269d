"""Interlaced images are detected, and their exposures are not trusted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc import calibrate
from ospc.correspondence.interlacing import row_alternation
from ospc.settings import DefaultSettings
from ospc.settings.grey_values import MIN_INTERLACED_ALTERNATION
from ospc.simulation import SimulationSettings, frames

QUICK = replace(DefaultSettings(), points_per_pair=150, rounds=5, response_intervals=16)


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
def test_texture_and_row_noise_are_not_mistaken_for_interlacing(seed, smoothing_px, max_grey, row_noise):
    rows = np.random.default_rng([seed, 1]).normal(0, row_noise, (240, 1))
    image = as_image(texture(seed, smoothing_px) + rows, max_grey)
    assert row_alternation(image, max_grey) < 0.55


@given(st.integers(0, 2**32 - 1), st.floats(3, 6), st.sampled_from([255, 4095]), st.sampled_from([7, 12]))
def test_a_second_field_of_another_moment_shows(seed, smoothing_px, max_grey, shift_px):
    grey = texture(seed, smoothing_px)
    image = as_image(woven(grey, np.roll(grey, shift_px, axis=1)), max_grey)
    assert row_alternation(image, max_grey) > MIN_INTERLACED_ALTERNATION


@given(st.integers(0, 2**32 - 1), st.floats(0.5, 6), st.booleans())
def test_fields_that_were_made_to_whole_images_are_not_interlaced(seed, smoothing_px, doubled):
    grey = texture(seed, smoothing_px)
    between = grey[::2] if doubled else (grey[::2] + np.roll(grey[::2], -1, axis=0)) / 2
    whole = np.stack([grey[::2], between], axis=1).reshape(grey.shape)
    assert row_alternation(as_image(whole), 255) < 0.2


@given(st.integers(0, 2**32 - 1), st.floats(3, 6), st.floats(0.5, 0.8))
def test_a_bayer_mosaic_is_not_interlaced(seed, smoothing_px, red):
    grey = texture(seed, smoothing_px)
    mosaic = grey.copy()
    mosaic[::2, ::2] *= red
    mosaic[1::2, 1::2] *= red / 2
    assert row_alternation(as_image(mosaic), 255) < MIN_INTERLACED_ALTERNATION


@given(st.integers(0, 255), st.tuples(st.integers(1, 40), st.integers(1, 40)))
def test_even_and_tiny_images_are_not_interlaced(level, shape):
    assert row_alternation(np.full(shape, level, np.uint8), 255) == 0


@pytest.fixture(scope="module")
def recording():
    return list(frames(SimulationSettings(size=(200, 150), frames=36, seed=3, scene_seed=0)))


@pytest.mark.parametrize("interlaced", [False, True])
def test_exposures_of_interlaced_images_are_not_trusted(recording, interlaced):
    if interlaced:
        later = [*recording[1:], recording[-1]]
        recording = [
            replace(frame, load=partial(woven, frame.image, next_one.image))
            for frame, next_one in zip(recording, later, strict=True)
        ]
    found = calibrate(recording, QUICK)
    assert any("interlaced" in warning for warning in found.warnings) == interlaced
    assert ("interlaced" in found.verdicts["exposures"].reason) == interlaced
    states = {verdict.state for verdict in found.verdicts.values()}
    assert ("identifiable" in states) != interlaced
