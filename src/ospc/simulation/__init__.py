"""A camera that makes recordings with known truth, M = f(e · V · L) plus noise.

:func:`frames` gives them in memory, :func:`simulate` writes them, :func:`truth` says what is true of them.
"""

from ospc.simulation.camera import SimulatedRecording, frames, irradiances, simulate
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.truth import Truth, truth

__all__ = ["SimulatedRecording", "SimulationSettings", "Truth", "frames", "irradiances", "simulate", "truth"]
