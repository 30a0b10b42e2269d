"""Flat surfaces in space with their radiance.

They are opaque and Lambertian: the radiance of a scene point does not depend on the viewing direction, as every
photometric calibration from a moving camera assumes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray, read_only

UP = read_only(np.array([0.0, 0.0, 1.0]))
"""Unit vector pointing up in the world."""
_AMBIENT = 0.008
"""Ambient irradiance at every point, relative to 1/d² from a lamp of strength 1, so that no surface is black."""
_DIFFUSE_SHARE = 0.06
"""Share of a lamp's light without the cosine factor, which represents light reflected by other surfaces."""
_LAMP_RADIUS_SQUARED_M2 = 0.15
"""Added to the squared distance from a lamp, in square metres, so that surfaces near it are not too bright."""
_LIGHT_GRID = (32, 24)
"""Columns and rows at which the light on a surface is computed; it is smooth enough to be interpolated in between."""
_SMALLEST_LEVEL = 12
"""Edge length, in texels, at which a pyramid ends."""


@dataclass(frozen=True)
class Rectangle:
    """A rectangle in space: its first corner in the world, and unit vectors along the rows and columns of a texture.

    ``size_m`` is its extent along these two vectors.
    """

    corner_m: FloatArray
    across: FloatArray
    down: FloatArray
    size_m: tuple[float, float]

    @classmethod
    def upright(cls, centre_m: FloatArray, azimuth: float, size_m: tuple[float, float]) -> Rectangle:
        """Return a vertical rectangle facing a viewer who looks along ``azimuth`` (radians)."""
        across = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        return cls(centre_m - across * size_m[0] / 2 + UP * size_m[1] / 2, across, -UP, size_m)

    @cached_property
    def normal(self) -> FloatArray:
        """Unit normal on the side from which the texture is not mirrored."""
        return np.asarray(np.cross(self.down, self.across))

    def grid(self, columns: int, rows: int) -> FloatArray:
        """Return the centres of a grid of equal cells, shape (rows, columns, 3)."""
        a = (np.arange(columns) + 0.5) / columns * self.size_m[0]
        d = (np.arange(rows) + 0.5) / rows * self.size_m[1]
        return np.asarray(self.corner_m + a[None, :, None] * self.across + d[:, None, None] * self.down)


@dataclass(frozen=True)
class Face:
    """A rectangle with its radiance as a mipmap; each level has half the size of the previous one."""

    place: Rectangle
    mips: tuple[Float32Array, ...]


@dataclass(frozen=True)
class Solid:
    """The faces of a convex body, and its bounding sphere; faces turned away from the camera are not drawn."""

    faces: tuple[Face, ...]
    centre_m: FloatArray
    radius_m: float


@dataclass(frozen=True)
class Lamp:
    """A small light source: position, shape (3,), and strength."""

    position_m: FloatArray
    strength: float


def irradiance(points_m: FloatArray, normal: FloatArray, lamps: tuple[Lamp, ...]) -> FloatArray:
    """Return the irradiance at points, from inverse squares, cosines and ambient light, shape (..., 3) -> (...)."""
    total = np.full(points_m.shape[:-1], _AMBIENT)
    for lamp in lamps:
        towards = lamp.position_m - points_m
        squared = np.sum(towards**2, axis=-1)
        cosine = np.maximum(towards @ normal, 0) / np.sqrt(squared)
        reflected = _DIFFUSE_SHARE + (1 - _DIFFUSE_SHARE) * cosine
        total += lamp.strength * reflected / (squared + _LAMP_RADIUS_SQUARED_M2)
    return total


def lit(place: Rectangle, reflectance: Float32Array, lamps: tuple[Lamp, ...]) -> Face:
    """Return a face that reflects the light of lamps with the given reflectance."""
    light = irradiance(place.grid(*_LIGHT_GRID), place.normal, lamps)
    height, width = reflectance.shape
    smooth = cv2.resize(np.log(light).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return Face(place, pyramid(reflectance * np.exp(smooth)))


def pyramid(image: Float32Array) -> tuple[Float32Array, ...]:
    """Return an image and its averages over blocks of 2, 4, 8, … texels, as read-only arrays."""
    levels = [np.ascontiguousarray(image, dtype=np.float32)]
    while min(levels[-1].shape) > _SMALLEST_LEVEL:
        height, width = levels[-1].shape
        smaller = cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(smaller, dtype=np.float32))
    return tuple(map(read_only, levels))
