"""Signs of local tone mapping, in brightness changes whose response and image regions are known."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.arrays import FloatArray
from ospc.exposures.brightness import BrightnessChange, PixelSamples
from ospc.exposures.tone_mapping import local_tone

RNG = np.random.default_rng(4)
PLACES = RNG.uniform(-0.7, 0.7, (300, 2))
LOG_LIGHT = 1.2 * PLACES[:, 0] + RNG.uniform(-1.0, 0.6, len(PLACES))
"""Regions on the left are darker than those on the right."""
BRACKETS = np.tile([0.6, 0.6, -1.2], 15)
"""Changes of ln exposure in a cycle of three exposures."""


def log_grey(log_irradiance: FloatArray) -> FloatArray:
    """Return ln M of a response with toe and shoulder."""
    return 0.55 * np.tanh(1.5 * log_irradiance) - 0.9


def change_of(number: int, log_change: float, tone: FloatArray) -> BrightnessChange:
    before, after = (log_grey(LOG_LIGHT + side * log_change / 2 - 0.3) for side in (-1, 1))
    ratio = after - before + tone + RNG.normal(0, 0.002, len(PLACES))
    samples = PixelSamples(ratio, (before + after) / 2, PLACES, PLACES)
    nothing = np.zeros(10)
    return BrightnessChange(number, number + 1, nothing, nothing, np.zeros((10, 4)), 1.0, 0.0, samples)


@pytest.mark.parametrize("changes", [BRACKETS, 0.3 * BRACKETS, RNG.normal(0, 0.3, 40)])
def test_a_curved_response_is_not_taken_for_local_tone_mapping(changes: FloatArray) -> None:
    found = local_tone([change_of(i, change, np.zeros(1)) for i, change in enumerate(changes)], changes)
    assert found is not None
    assert not found.text


@pytest.mark.parametrize("changes", [BRACKETS, RNG.normal(0, 0.3, 40)])
def test_regions_that_brighten_differently_are_a_sign_of_local_tone_mapping(changes: FloatArray) -> None:
    tones = RNG.normal(0, 0.04, (len(changes), 4))
    column = np.clip((PLACES[:, 0] / 0.7 + 1) * 2, 0, 3).astype(int)
    found = local_tone([change_of(i, each, tones[i][column]) for i, each in enumerate(changes)], changes)
    assert found is not None
    assert found.is_clear
