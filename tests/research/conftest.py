"""Fixtures of the tests of studies."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ospc.simulation import SimulationSettings, simulate


@pytest.fixture(scope="session")
def tiny_room(tmp_path_factory) -> Path:
    """Return a simulated recording that is just long enough to be opened."""
    place = tmp_path_factory.mktemp("studies") / "room"
    simulate(place, SimulationSettings(size=(96, 72), frames=6, speed=0.5))
    return place


@pytest.fixture(scope="module", autouse=True)
def no_real_data(one_room: None) -> Iterator[None]:
    """Keep commands from adding real recordings of this machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("OSPC_DATA", raising=False)
        yield
