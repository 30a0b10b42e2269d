"""A simulated camera with known truth: M = f(e · V · L) plus noise.

:func:`frames` yields frames in memory, :func:`simulate` writes a recording, and :func:`truth` returns only the truth.
"""

from ospc.simulation.camera import SimulatedRecording, frames, irradiances, simulate
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.truth import Truth, truth

__all__ = ["SimulatedRecording", "SimulationSettings", "Truth", "frames", "irradiances", "simulate", "truth"]
