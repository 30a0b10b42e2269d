"""Depth of a simulated scene, as a depth camera in the place of the simulated one would measure it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import RecordingError, SettingError
from ospc.research.odometry.alignment import Camera, Pose
from ospc.simulation.scene import Scene
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.surface import Rectangle

_TRUTH = "truth.json"
_MOST_BYTES = 256_000_000
_NEAR_M = 0.02
"""Surfaces nearer than this to the camera are ignored."""


@dataclass(frozen=True)
class SceneDepth:
    """The surfaces, none of which moves, on which the rays of a camera end."""

    camera: Camera
    places: tuple[Rectangle, ...]

    @classmethod
    def of(cls, folder: Path) -> SceneDepth:
        """Build the scene of a simulated recording."""
        place = folder / _TRUTH
        try:
            if place.stat().st_size > _MOST_BYTES:
                raise ValueError("too large")
            content = json.loads(place.read_text(encoding="utf-8"))
            settings = content["settings"]
            scene_seed = settings["seed"] if settings["scene_seed"] is None else settings["scene_seed"]
            width, height = (int(n) for n in settings["size"])
            focal = float(content["focal_px"])
            scene = Scene.of(SimulationSettings(scene_seed=int(scene_seed), size=(width, height)))
        except (OSError, ValueError, KeyError, TypeError, RecursionError, SettingError) as error:
            raise RecordingError(
                f"{folder}: the built-in odometry needs the depth of a simulated scene, which {_TRUTH} does not "
                f"describe ({type(error).__name__}); make the recording with 'ospc simulate', or use --program"
            ) from None
        faces = (*scene.walls, *scene.pictures, *(face for solid in scene.solids for face in solid.faces))
        centre_px = (np.array((width, height)) - 1) / 2
        return cls(Camera(focal, centre_px), tuple(face.place for face in faces))

    def at(self, points: FloatArray, pose: Pose) -> FloatArray:
        """Return the depth along the optical axis of pixels (x, y), in metres, shape (n, 2) -> (n,).

        The pose maps the coordinates of the camera to the world.
        """
        rays = self.camera.lift(points, np.ones(len(points))) @ pose.rotation.T
        nearest = np.full(len(points), np.inf)
        for place in self.places:
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = float((place.corner_m - pose.translation) @ place.normal) / (rays @ place.normal)
                on_plane = pose.translation + depth[:, None] * rays - place.corner_m
                across, down = on_plane @ place.across, on_plane @ place.down
                hit = (depth > _NEAR_M) & (across >= 0) & (down >= 0)
                hit &= (across <= place.size_m[0]) & (down <= place.size_m[1])
            nearest = np.where(hit & (depth < nearest), depth, nearest)
        return nearest
