"""A tiny recording to which faults are applied."""

from __future__ import annotations

import pytest

from ospc.research.faults.footage import Footage, good_footage
from ospc.research.source import SimulatedSource
from ospc.simulation import SimulationSettings

SETTINGS = SimulationSettings(size=(64, 48), frames=60, seed=3, scene_seed=0, response="srgb", auto_rate=0.3)


@pytest.fixture(scope="session")
def tiny_source() -> SimulatedSource:
    return SimulatedSource("tiny", SETTINGS)


@pytest.fixture(scope="session")
def footage(tiny_source) -> Footage:
    return good_footage(tiny_source)
