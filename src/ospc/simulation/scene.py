"""The scene: a room with pictures on its walls, boxes in front of them, and moving patches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ospc.arrays import Float32Array
from ospc.simulation.motion import EYE_HEIGHT_M
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.surface import UP, Face, Lamp, Rectangle, Solid, lit, pyramid
from ospc.simulation.texture import painted, photograph, single, strewn, tiled

ROOM_M = (4.2, 3.4, 2.8)
"""Half length, half width and height of the room, in metres."""
REFERENCE_IRRADIANCE = 0.12
"""Irradiance of the median wall at the reference exposure, relative to saturation: mid grey at a gamma of 2.2."""
_RING_M = 2.35
"""Distance of the boxes from the middle of the room, in metres; the camera stays within 1.1 m of it."""
_BOX_AZIMUTHS_DEG = (40, 90, 140, 220, 270, 320)
"""Azimuths of the boxes, which leave the long axis of the room free."""
_PATCH_M = (0.42, 0.34)
"""Width and height of a moving patch, in metres."""
_NEAREST_PATCH_M, _PATCH_SPACING_M = 1.4, 0.027
"""Distance of the nearest patch from the middle of the room, and distance between patches, in metres. The corners of
a flat patch are 0.026 m further out than its middle, so patches never intersect."""
_WINDOW_M = (1.5, 1.1)
"""Width and height of the window, in metres."""
_DOOR_M = (0.95, 2.05)
"""Width and height of the doorway, in metres."""
_COATS = (
    (tiled, "brick", 2.0, 1.2, 0.28),
    (strewn, "gravel", 2.6, 0.35, 0.45),
    (tiled, "brick", 1.5, 0.9, 0.12),
    (strewn, "grass", 1.7, 0.35, 0.5),
)
"""Wall coverings, with edge length in metres, contrast and level of their textures: pale bricks, plaster, dark
bricks, rough wallpaper."""

_PICTURES = ("camera", "coffee", "chelsea")


@dataclass(frozen=True)
class Patch:
    """A patch that floats along its own smooth path, facing the middle of the room.

    Each patch keeps its own distance from the middle. Patches therefore never intersect, and for any camera position,
    inner patches are in front of outer ones.
    """

    mips: tuple[Float32Array, ...]
    azimuth: float
    swing: float
    period_s: float
    phase: float
    distance_m: float

    def at(self, time_s: float) -> Face:
        """Return its face at an instant in seconds."""
        turn = 2 * np.pi * time_s / self.period_s + self.phase
        azimuth = self.azimuth + self.swing * np.sin(turn)
        height = EYE_HEIGHT_M + 0.28 * np.sin(1.7 * turn + self.azimuth)
        centre = np.array([self.distance_m * np.cos(azimuth), self.distance_m * np.sin(azimuth), height])
        level = Rectangle.upright(centre, azimuth, _PATCH_M)
        tilt = 0.4 * np.sin(0.8 * turn)
        across = np.cos(tilt) * level.across + np.sin(tilt) * level.down
        down = np.cos(tilt) * level.down - np.sin(tilt) * level.across
        corner = centre - across * _PATCH_M[0] / 2 - down * _PATCH_M[1] / 2
        return Face(Rectangle(corner, across, down, _PATCH_M), self.mips)


@dataclass(frozen=True)
class Scene:
    """Everything in front of the camera."""

    walls: tuple[Face, ...]
    """The inside of a convex room: exactly one wall in every direction."""
    pictures: tuple[Face, ...]
    """Pictures, flat on the walls."""
    solids: tuple[Solid, ...]
    """Boxes in front of the walls. The radical plane of the bounding spheres of any two boxes separates them."""
    patches: tuple[Patch, ...]
    """Moving patches between camera and boxes, outermost first."""
    scale: float
    """Factor from the radiance of the faces to irradiance per millisecond, relative to saturation."""

    @classmethod
    def of(cls, settings: SimulationSettings) -> Scene:
        """Build and light the room."""
        room, median = _room(settings.seed if settings.scene_seed is None else settings.scene_seed)
        scale = REFERENCE_IRRADIANCE / median / settings.reference_exposure_ms
        return replace(room, patches=_patches(settings.seed, settings.moving_objects, median), scale=scale)


@lru_cache(maxsize=2)
def _room(seed: int) -> tuple[Scene, float]:
    """Build a room without patches, and return it with the median radiance of its walls."""
    # The last two rooms are cached, because comparisons of cameras use the same room many times.
    rng = np.random.default_rng([seed, 2])
    window_side = int(rng.choice([0, 2]))
    lamps = _lamps(rng, window_side)
    walls = _walls(rng, lamps)
    median = float(np.median(np.concatenate([face.mips[4].ravel() for face in walls])))
    return Scene(walls, _pictures(rng, lamps, window_side), _furniture(rng, lamps), (), 1.0), median


def _wall(side: int) -> Rectangle:
    """Return the wall at azimuth 90° times ``side``."""
    length, width, height = ROOM_M
    azimuth = side * np.pi / 2
    distance, extent = (length, 2 * width) if side % 2 == 0 else (width, 2 * length)
    centre = np.array([np.cos(azimuth) * distance, np.sin(azimuth) * distance, height / 2])
    return Rectangle.upright(centre, azimuth, (extent, height))


def _on_wall(side: int, along_m: float, height_m: float, size_m: tuple[float, float]) -> Rectangle:
    """Return a rectangle 1 cm in front of a wall, ``along_m`` to the right of its middle as viewed from inside."""
    wall = _wall(side)
    centre = wall.corner_m + wall.across * (wall.size_m[0] / 2 + along_m) + wall.normal * 0.01
    centre[2] = height_m
    return Rectangle.upright(centre, side * np.pi / 2, size_m)


def _lamps(rng: np.random.Generator, window_side: int) -> tuple[Lamp, ...]:
    """Place strong lights in the shape of a window at one end of the room, and a weak lamp at the other."""
    away = np.array([1.0 if window_side == 0 else -1.0, 1.0, 1.0])
    shift = rng.uniform(-0.5, 0.5)
    window = tuple(
        Lamp(away * np.array([ROOM_M[0] - 0.4, shift + dy, 1.75 + dz]), 1.0)
        for dy in (-0.6, 0.0, 0.6)
        for dz in (-0.4, 0.4)
    )
    lamp = Lamp(away * np.array([-2.2, -1.9 * np.sign(shift), ROOM_M[2] - 0.35]), 0.5)
    return (*window, lamp)


def _walls(rng: np.random.Generator, lamps: tuple[Lamp, ...]) -> tuple[Face, ...]:
    length, width, height = ROOM_M
    extent = (2 * length, 2 * width)
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    floor = Rectangle(np.array([-length, width, 0.0]), x, -y, extent)
    ceiling = Rectangle(np.array([-length, -width, height]), x, y, extent)
    ground = str(rng.choice(["gravel", "grass"]))
    faces = [
        lit(floor, strewn(ground, extent, rng, edge_m=1.9, contrast=0.8, level=0.16), lamps),
        lit(ceiling, strewn("gravel", extent, rng, edge_m=2.4, contrast=0.15, level=0.65), lamps),
    ]
    for side, coat in enumerate(rng.permutation(len(_COATS)).tolist()):
        wall = _wall(side)
        cover, name, edge_m, contrast, level = _COATS[coat]
        coating = cover(name, wall.size_m, rng, edge_m=edge_m, contrast=contrast, level=level)
        faces.append(lit(wall, coating, lamps))
    return tuple(faces)


def _pictures(rng: np.random.Generator, lamps: tuple[Lamp, ...], window_side: int) -> tuple[Face, ...]:
    """Add framed photographs and painted boards, a window to daylight, and a doorway to a dark room."""
    faces = []
    names = list(rng.permutation([*_PICTURES, *_PICTURES]))
    door_side = int(rng.permutation([side for side in range(4) if side != window_side])[0])
    for side in range(4):
        half = _wall(side).size_m[0] / 2
        if side == window_side:
            view = np.float32(5.0) * single("grass", _WINDOW_M, 0.05) + np.float32(0.5)
            faces.append(Face(_on_wall(side, 0.0, 1.6, _WINDOW_M), pyramid(view)))
        if side == door_side:
            inside = np.float32(0.006) * single("coffee", _DOOR_M, 0.0)
            faces.append(Face(_on_wall(side, 0.0, _DOOR_M[1] / 2, _DOOR_M), pyramid(inside)))
        for along in (-0.62 * half, 0.0, 0.62 * half):
            size = (float(rng.uniform(0.7, 1.25)), float(rng.uniform(0.6, 1.0)))
            place = _on_wall(side, along + float(rng.uniform(-0.2, 0.2)), float(rng.uniform(1.2, 1.8)), size)
            if along == 0.0 and side in (window_side, door_side):
                continue
            if names and rng.random() < 0.65:
                faces.append(lit(place, single(str(names.pop()), size, 0.04), lamps))
            else:
                faces.append(lit(place, painted(size, rng, float(rng.choice([0.03, 0.08, 0.85]))), lamps))
    return tuple(faces)


def _furniture(rng: np.random.Generator, lamps: tuple[Lamp, ...]) -> tuple[Solid, ...]:
    """Place boxes in a ring that leaves the long axis of the room free."""
    solids = []
    for azimuth_deg in _BOX_AZIMUTHS_DEG:
        azimuth = np.radians(azimuth_deg + rng.uniform(-8, 8))
        width, depth, height = rng.uniform(0.4, 0.75), rng.uniform(0.35, 0.6), rng.uniform(0.6, 1.5)
        name = str(rng.choice(["brick", "gravel", "camera", "coffee", "chelsea", "grass", ""]))
        level = float(rng.choice([0.06, 0.2, 0.5]))
        centre = np.array([_RING_M * np.cos(azimuth), _RING_M * np.sin(azimuth), height / 2])
        turn = azimuth + rng.uniform(-0.6, 0.6)
        faces = []
        for quarter in range(4):
            look = turn + quarter * np.pi / 2
            across, through = (width, depth) if quarter % 2 == 0 else (depth, width)
            forward = np.array([np.cos(look), np.sin(look), 0.0])
            place = Rectangle.upright(centre - forward * through / 2, look, (across, height))
            coat = _box_coat(name, place.size_m, rng, level)
            faces.append(lit(place, coat, lamps))
        forward, right = np.array([np.cos(turn), np.sin(turn), 0.0]), faces[0].place.across
        corner = centre + UP * height / 2 + forward * depth / 2 - right * width / 2
        top = Rectangle(corner, right, -forward, (width, depth))
        faces.append(lit(top, painted((width, depth), rng, 0.6), lamps))
        solids.append(Solid(tuple(faces), centre, float(np.linalg.norm([width, depth, height]) / 2)))
    return tuple(solids)


def _box_coat(name: str, size_m: tuple[float, float], rng: np.random.Generator, level: float) -> Float32Array:
    """Return the texture of a side of a box: a picture, a rough material, or paint if the name is empty."""
    if name in _PICTURES:
        return single(name, size_m)
    if name == "brick":
        return tiled(name, size_m, rng, edge_m=1.0, contrast=0.9, level=level)
    if name:
        return strewn(name, size_m, rng, edge_m=1.0, contrast=0.8, level=level)
    return painted(size_m, rng, level)


def _patches(seed: int, count: int, radiance: float) -> tuple[Patch, ...]:
    rng = np.random.default_rng([seed, 5])
    names = ("chelsea", "coffee", "brick", "camera", "gravel", "grass")
    made = []
    for number in range(count):
        reflectance = single(names[number % len(names)], _PATCH_M, 0.02)
        brightness = np.float32(radiance * rng.uniform(1.0, 4.0) / np.mean(photograph(names[number % len(names)])))
        made.append(
            Patch(
                pyramid(reflectance * brightness),
                float(2 * np.pi * (number + rng.uniform(0, 0.5)) / count),
                float(rng.uniform(0.4, 0.9)),
                float(rng.uniform(4.0, 9.0)),
                float(rng.uniform(0, 2 * np.pi)),
                _NEAREST_PATCH_M + _PATCH_SPACING_M * number,
            )
        )
    return tuple(reversed(made))
