"""What the tests of studies share: small recordings, simulated once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ospc.simulation import SimulationSettings, scene, simulate


@pytest.fixture(scope="module", autouse=True)
def one_room() -> Iterator[None]:
    """Film the same room whatever the seed: it takes longer to build than most recordings here to film."""
    room = scene._room
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "_room", lambda _seed: room(0))
        yield


@pytest.fixture(scope="session")
def tiny_room(tmp_path_factory) -> Path:
    """Return a simulated recording that is just long enough to be read."""
    place = tmp_path_factory.mktemp("studies") / "room"
    simulate(place, SimulationSettings(size=(96, 72), frames=6, speed=0.5))
    return place


@pytest.fixture(scope="module", autouse=True)
def no_real_data() -> Iterator[None]:
    """Keep commands from adding real recordings where the machine has some."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("OSPC_DATA", raising=False)
        yield
