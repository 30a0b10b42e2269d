"""Noise, response, clipping and quantisation of the simulated sensor."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.simulation import SimulationSettings
from ospc.simulation.camera import Sensor
from ospc.simulation.responses import RESPONSES

SHAPE = (400, 500)


def flat(value):
    return np.full(SHAPE, value, np.float32)


@pytest.mark.parametrize("preset", ["low", "high"])
@pytest.mark.parametrize("gain", [1.0, 4.0])
@pytest.mark.parametrize("irradiance", [0.05, 0.2, 0.6])
def test_noise_has_the_variance_of_counted_electrons(preset, gain, irradiance):
    settings = SimulationSettings(response="linear", noise=preset, bit_depth=16)
    full_well, read_noise = settings.sensor
    image = Sensor(RESPONSES["linear"](), settings).expose(flat(irradiance), frame=3, gain=gain) / 65535
    expected = irradiance * gain / full_well + (read_noise * gain / full_well) ** 2
    assert image.mean() == pytest.approx(irradiance, abs=5 * np.sqrt(expected / image.size))
    assert image.var() == pytest.approx(expected, rel=0.02)
    assert abs(np.corrcoef(image[:, 1:].ravel(), image[:, :-1].ravel())[0, 1]) < 0.01


def test_frames_have_independent_but_repeatable_noise():
    sensor = Sensor(RESPONSES["linear"](), SimulationSettings(response="linear", bit_depth=16))
    one, again, other = (sensor.expose(flat(0.3), frame=frame) for frame in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert abs(np.corrcoef(one.ravel().astype(float), other.ravel().astype(float))[0, 1]) < 0.01


@pytest.mark.parametrize("name", RESPONSES)
@pytest.mark.parametrize("bits", [8, 10, 16])
def test_without_noise_a_grey_value_is_the_rounded_response(name, bits):
    settings = SimulationSettings(response=name, noise="none", bit_depth=bits)
    response = RESPONSES[name]()
    irradiance = np.linspace(0, 1, SHAPE[0] * SHAPE[1]).reshape(SHAPE).astype(np.float32)
    grey = Sensor(response, settings).expose(irradiance, frame=0)
    assert grey.dtype == (np.uint8 if bits == 8 else np.uint16)
    exact = response(irradiance) * settings.max_grey
    assert np.abs(grey - exact).max() <= 0.5 + 0.01 * settings.max_grey / 255
    assert np.all(np.diff(grey.ravel().astype(int)) >= 0)


@pytest.mark.parametrize("bits", [8, 12])
def test_what_is_too_bright_clips_and_nothing_wraps_around(bits):
    settings = SimulationSettings(noise="high", bit_depth=bits)
    sensor = Sensor(RESPONSES["gamma2.2"](), settings)
    assert np.all(sensor.expose(flat(50.0), frame=0) == settings.max_grey)
    dark = sensor.expose(flat(0.0), frame=0)
    assert np.median(dark) < 0.15 * settings.max_grey
    assert np.mean(dark == 0) == pytest.approx(0.5, abs=0.05), "half the read noise lies below black"


def test_the_input_stays_as_it_was():
    irradiance = flat(2.0)
    Sensor(RESPONSES["linear"](), SimulationSettings(noise="none")).expose(irradiance, frame=0)
    assert np.all(irradiance == 2.0)
