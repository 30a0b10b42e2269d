"""Simulated recordings in memory, with what is true of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ospc.recording import Frame
from ospc.simulation import SimulationSettings, Truth, frames, truth


@dataclass(frozen=True)
class Recorded:
    """A simulated recording and what is true of it."""

    frames: list[Frame]
    truth: Truth


def recorded(**settings) -> Recorded:
    """Simulate a small recording."""
    chosen = replace(SimulationSettings(size=(320, 240)), **settings)
    known = truth(chosen)
    return Recorded(list(frames(chosen, known)), known)
