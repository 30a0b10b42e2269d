"""Flat surfaces in space, each with a radiance of its own.

They are opaque and reflect evenly in all directions (Lambert), so that a scene point has one radiance whatever it is
seen from: the assumption behind every photometric calibration from moving cameras.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray

UP = np.array([0.0, 0.0, 1.0])
UP.setflags(write=False)


@dataclass(frozen=True)
class Rectangle:
    """A rectangle in space.

    Attributes
    ----------
    corner_m
        World position of its first corner, shape (3,).
    across, down
        Unit vectors of a texture's columns and rows on it, shape (3,).
    size_m
        Extent along both.
    """

    corner_m: FloatArray
    across: FloatArray
    down: FloatArray
    size_m: tuple[float, float]

    @classmethod
    def upright(cls, centre_m: FloatArray, azimuth: float, size_m: tuple[float, float]) -> Rectangle:
        """Return a vertical one that is seen by somebody who looks along ``azimuth`` (radians)."""
        across = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        return cls(centre_m - across * size_m[0] / 2 + UP * size_m[1] / 2, across, -UP, size_m)

    @cached_property
    def normal(self) -> FloatArray:
        """Direction to which it shows a texture unmirrored."""
        return np.asarray(np.cross(self.down, self.across))

    @property
    def corners_m(self) -> FloatArray:
        """Its four corners in order, shape (4, 3)."""
        a, d = self.across * self.size_m[0], self.down * self.size_m[1]
        return np.asarray(self.corner_m + np.array([0 * a, a, a + d, d]))

    def grid(self, columns: int, rows: int) -> FloatArray:
        """Return the centres of equal cells on it, shape (rows, columns, 3)."""
        a = (np.arange(columns) + 0.5) / columns * self.size_m[0]
        d = (np.arange(rows) + 0.5) / rows * self.size_m[1]
        return np.asarray(self.corner_m + a[None, :, None] * self.across + d[:, None, None] * self.down)


@dataclass(frozen=True)
class Face:
    """A rectangle with its radiance.

    Attributes
    ----------
    place
        Where it is.
    mips
        Radiance, stretched over the rectangle; each level half as large as the one before.
    """

    place: Rectangle
    mips: tuple[Float32Array, ...]


@dataclass(frozen=True)
class Solid:
    """The faces of a convex body.

    Attributes
    ----------
    faces
        Its faces; those that look away from the camera are not drawn.
    centre_m, radius_m
        A sphere around it.
    """

    faces: tuple[Face, ...]
    centre_m: FloatArray
    radius_m: float


@dataclass(frozen=True)
class Lamp:
    """A small source of light: position, shape (3,), and strength."""

    position_m: FloatArray
    strength: float


def irradiance(points_m: FloatArray, normal: FloatArray, lamps: tuple[Lamp, ...]) -> FloatArray:
    """Return the light that falls on points, shape (..., 3) -> (...): inverse squares, cosines, some ambient."""
    total = np.full(points_m.shape[:-1], 0.008)
    for lamp in lamps:
        towards = lamp.position_m - points_m
        squared = np.sum(towards**2, axis=-1)
        cosine = np.maximum(towards @ normal, 0) / np.sqrt(squared)
        # The part without a cosine stands for light that the other surfaces throw back.
        total += lamp.strength * (0.06 + 0.94 * cosine) / (squared + 0.15)
    return total


def lit(place: Rectangle, reflectance: Float32Array, lamps: tuple[Lamp, ...]) -> Face:
    """Return a face that reflects the light of lamps."""
    light = irradiance(place.grid(32, 24), place.normal, lamps)
    height, width = reflectance.shape
    smooth = cv2.resize(np.log(light).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return Face(place, pyramid(reflectance * np.exp(smooth)))


def pyramid(image: Float32Array) -> tuple[Float32Array, ...]:
    """Return an image and its area averages over 2, 4, 8, … elements; read-only."""
    levels = [np.ascontiguousarray(image, dtype=np.float32)]
    while min(levels[-1].shape) > 12:
        height, width = levels[-1].shape
        smaller = cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(smaller, dtype=np.float32))
    for level in levels:
        level.setflags(write=False)
    return tuple(levels)
