"""The motion of the camera: smooth functions of time, so that a pose is defined at every instant of an exposure.

World axes: x and y horizontal, z up, metres, origin on the floor in the middle of the room.
Camera axes: x right, y down, z forward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray
from ospc.simulation.settings import SimulationSettings

EYE_HEIGHT_M = 1.35
"""Mean height of the camera above the floor, in metres: held in front of the chest."""
REACH_M = 1.1
"""Largest horizontal distance of the camera from the middle of the room, in metres; all objects are further away."""
_SPREAD = (0.85, 1.15)
"""Range of the random factor on each amplitude and period, so that each seed gives a different motion."""
_Waves = tuple[tuple[float, float], ...]

_HANDHELD: dict[str, _Waves] = {
    "x": ((0.75, 13.0), (0.25, 4.7), (0.004, 0.21)),
    "y": ((0.65, 10.3), (0.25, 5.3), (0.004, 0.23)),
    "z": ((0.18, 6.1), (0.03, 1.1), (0.003, 0.19)),
    "yaw": ((120.0, 25.0), (30.0, 7.3), (8.0, 3.1), (0.5, 0.83), (0.08, 0.17)),
    "pitch": ((14.0, 8.7), (8.0, 4.3), (2.0, 1.9), (0.4, 0.71), (0.08, 0.16)),
    "roll": ((7.0, 7.9), (3.0, 2.9), (0.4, 0.9), (0.06, 0.18)),
}
_PAN: dict[str, _Waves] = {
    "yaw": ((110.0, 24.0), (6.0, 4.1)),
    "pitch": ((16.0, 6.3), (3.0, 2.9)),
    "roll": ((2.0, 7.0),),
}
_FORWARD: dict[str, _Waves] = {
    "x": ((0.95, 9.0),),
    "y": ((0.10, 5.3), (0.02, 1.1)),
    "z": ((0.06, 4.7), (0.02, 0.9)),
    "yaw": ((5.0, 7.1), (0.5, 0.9)),
    "pitch": ((4.0, 5.3), (0.4, 0.8)),
    "roll": ((2.0, 6.1), (0.3, 0.9)),
}
_WAVES: dict[str, dict[str, _Waves]] = {"handheld": _HANDHELD, "static": _HANDHELD, "pan": _PAN, "forward": _FORWARD}
"""Amplitude (metres or degrees) and period (seconds) of the oscillations of each coordinate. Slow ones move the
camera through the room, those of a few seconds look around, and those below a second are hand tremor."""

_AXES = ("x", "y", "z", "yaw", "pitch", "roll")


@dataclass(frozen=True)
class Motion:
    """A sum of oscillations with random phases for each coordinate of the pose."""

    amplitude: FloatArray
    period_s: FloatArray
    phase: FloatArray
    """Shape (6, k): x, y, z in metres; yaw, pitch, roll in radians; rows are padded with amplitude 0."""
    moving: bool
    """Whether the pose changes with time."""

    @classmethod
    def of(cls, settings: SimulationSettings) -> Motion:
        """Draw a random motion of the kind in the settings."""
        rng = np.random.default_rng([settings.seed, 1])
        waves = _WAVES[settings.motion]
        most = max(len(w) for w in waves.values())
        amplitude = np.zeros((6, most))
        period = np.ones((6, most))
        for row, axis in enumerate(_AXES):
            for column, (size, seconds) in enumerate(waves.get(axis, ())):
                amplitude[row, column], period[row, column] = size, seconds
        amplitude *= rng.uniform(*_SPREAD, amplitude.shape)
        amplitude[3:] = np.radians(amplitude[3:])
        period *= rng.uniform(*_SPREAD, period.shape) / settings.speed
        phase = rng.uniform(0, 2 * np.pi, period.shape)
        return cls(amplitude, period, phase, settings.motion != "static")

    def at(self, time_s: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the poses at instants in seconds, shape (n,).

        They are the positions in the world in metres, shape (n, 3), and camera-to-world rotations, shape (n, 3, 3).
        """
        time = np.atleast_1d(np.asarray(time_s, dtype=np.float64)) * (1.0 if self.moving else 0.0)
        angle = 2 * np.pi * time[:, None, None] / self.period_s + self.phase
        x, y, z, yaw, pitch, roll = np.sum(self.amplitude * np.sin(angle), axis=-1).T
        # Compress the horizontal position smoothly into a disc that is free of objects.
        shrink = (1 + ((x**2 + y**2) / REACH_M**2) ** 4) ** (-1 / 8)
        x, y = x * shrink, y * shrink
        position = np.stack([x, y, z + EYE_HEIGHT_M], axis=-1)
        return position, rotation(yaw, pitch, roll)


def rotation(yaw: FloatArray, pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """Return camera-to-world rotations, shape (n,) -> (n, 3, 3); at zero angles the camera looks along world x."""
    zero = np.zeros_like(yaw)
    forward = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)
    right = np.stack([np.sin(yaw), -np.cos(yaw), zero], axis=-1)
    down = np.cross(forward, right)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([c * right + s * down, c * down - s * right, forward], axis=-1)
