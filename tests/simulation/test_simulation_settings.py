"""Impossible settings are refused on construction."""

from __future__ import annotations

import math
from dataclasses import fields

import pytest

from ospc.errors import SettingError
from ospc.simulation import SimulationSettings

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    "values",
    [
        {"size": (0, 480)},
        {"size": (640.0, 480)},
        {"size": (640,)},
        {"size": 640},
        {"size": (100_000, 480)},
        {"frames": 0},
        {"frames": 2.5},
        {"fps": 0.0},
        {"fps": NAN},
        {"seed": -1},
        {"seed": 1.5},
        {"scene_seed": -3},
        {"bit_depth": 7},
        {"bit_depth": 17},
        {"bit_depth": 12, "image_format": "jpg"},
        {"noise": "medium"},
        {"noise": "none", "read_noise_electrons": 3.0},
        {"full_well_electrons": 0.0},
        {"full_well_electrons": NAN},
        {"read_noise_electrons": -1.0},
        {"motion": "flying"},
        {"speed": -1.0},
        {"horizontal_fov_deg": 179.0},
        {"motion_blur_samples": 0},
        {"exposure": "manual"},
        {"exposure": "cycle", "exposures_ms": ()},
        {"exposure": "cycle", "exposures_ms": (1.0, -2.0)},
        {"exposure": "cycle", "exposures_ms": 5.0},
        {"exposure": "file", "exposures_ms": (1.0, 2.0)},
        {"exposure_ms": INF},
        {"exposure_min_ms": 5.0, "exposure_max_ms": 1.0},
        {"auto_target": 1.0},
        {"auto_target": "bright"},
        {"gain": 4.0},
        {"lag": 500},
        {"metadata_error": -0.1},
        {"flicker": 1.0},
        {"moving_objects": -1},
        {"moving_objects": 1000},
        {"image_format": "tiff"},
        {"jpg_quality": 0},
    ],
)
def test_impossible_settings_are_refused(values):
    with pytest.raises(SettingError, match="|".join(["electrons", "infinite full well", "JPEG", *values])):
        SimulationSettings(**values)


def test_every_setting_has_a_default_and_a_description():
    described = SimulationSettings.__doc__
    assert all(field.name in described for field in fields(SimulationSettings))
    assert SimulationSettings() == SimulationSettings()


def test_presets_can_be_overruled():
    assert SimulationSettings(noise="low", full_well_electrons=500.0).sensor == (500.0, 5.0)
    assert SimulationSettings(noise="none").sensor == (INF, 0.0)
