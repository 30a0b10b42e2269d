"""Simulated recordings in memory, with ground truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ospc.recording import Frame
from ospc.simulation import SimulationSettings, Truth, frames, truth


@dataclass(frozen=True)
class Recorded:
    frames: list[Frame]
    truth: Truth


def recorded(**settings) -> Recorded:
    chosen = replace(SimulationSettings(size=(320, 240)), **settings)
    known = truth(chosen)
    return Recorded(list(frames(chosen, known)), known)
