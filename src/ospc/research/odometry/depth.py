"""Depth of a simulated scene, as a depth camera in the place of the simulated one would measure it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import RecordingError, SettingError
from ospc.simulation.scene import Scene
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.surface import Rectangle

TRUTH = "truth.json"
_MOST_BYTES = 256_000_000
_NEAR_M = 0.02
"""Surfaces nearer than this to the camera are ignored."""


@dataclass(frozen=True)
class SceneDepth:
    """The surfaces on which the rays of a camera end.

    Attributes
    ----------
    size
        Width and height of the images.
    focal_px
        Focal length; the principal point is the image centre.
    places
        All surfaces that do not move.
    """

    size: ImageSize
    focal_px: float
    places: tuple[Rectangle, ...]

    @classmethod
    def of(cls, folder: Path) -> SceneDepth:
        """Build the scene of a simulated recording.

        Raises
        ------
        RecordingError
            If the folder is not a simulated recording.
        """
        place = folder / TRUTH
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
                f"{folder}: the built-in odometry needs the depth of a simulated scene, which {TRUTH} does not "
                f"describe ({type(error).__name__}); make the recording with 'ospc simulate', or use --program"
            ) from None
        faces = (*scene.walls, *scene.pictures, *(face for solid in scene.solids for face in solid.faces))
        return cls((width, height), focal, tuple(face.place for face in faces))

    @property
    def centre_px(self) -> FloatArray:
        """The principal point, shape (2,)."""
        return (np.array(self.size) - 1) / 2

    def at(self, points: FloatArray, position_m: FloatArray, rotation: FloatArray) -> FloatArray:
        """Return the depth along the optical axis of pixels, in metres, shape (n, 2) -> (n,).

        Parameters
        ----------
        points
            Pixels (x, y).
        position_m, rotation
            Of the camera in the world, shapes (3,) and (3, 3).
        """
        rays = np.column_stack([(points - self.centre_px) / self.focal_px, np.ones(len(points))]) @ rotation.T
        nearest = np.full(len(points), np.inf)
        for place in self.places:
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = float((place.corner_m - position_m) @ place.normal) / (rays @ place.normal)
                on_plane = position_m + depth[:, None] * rays - place.corner_m
                across, down = on_plane @ place.across, on_plane @ place.down
                hit = (depth > _NEAR_M) & (across >= 0) & (down >= 0)
                hit &= (across <= place.size_m[0]) & (down <= place.size_m[1])
            nearest = np.where(hit & (depth < nearest), depth, nearest)
        return nearest
