"""Two cameras in the same scene that differ only in the lens."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from ospc.recording import Frame
from ospc.simulation import SimulationSettings, frames


@dataclass(frozen=True)
class Cameras:
    """Frames of the same path recorded by two cameras."""

    before: list[Frame]
    after: list[Frame]


@pytest.fixture(scope="session")
def cameras() -> Cameras:
    """A camera, and the same camera with a lens of much stronger vignetting."""

    def walk(*coefficients: float) -> list[Frame]:
        settings = SimulationSettings(size=(240, 180), frames=90, noise="low", response="srgb", seed=5, speed=1.3)
        return list(frames(replace(settings, vignette="polynomial", vignette_coefficients=coefficients)))

    return Cameras(walk(-0.12, 0.0, -0.03), walk(-0.45, 0.05, -0.15))
