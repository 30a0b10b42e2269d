"""Reflectance of surfaces, made of the photographs that come with the package."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files

import cv2
import numpy as np

from ospc.arrays import Float32Array

TEXEL_M = 0.004
"""Edge of a texture element: the footprint of a 640-pixel-wide camera's pixel at about 1.7 m."""

_DARKEST, _BRIGHTEST = 0.015, 0.93
"""Reflectance of black paint and of white plaster."""


@lru_cache(maxsize=8)
def photograph(name: str) -> Float32Array:
    """Return one of the package's photographs as reflectance in (0, 1), linear in light, read-only."""
    content = (files("ospc.simulation") / "textures" / f"{name}.png").read_bytes()
    coded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    grey = np.asarray(coded, dtype=np.float64) / 255
    linear = np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)
    result = (_DARKEST + (_BRIGHTEST - _DARKEST) * linear).astype(np.float32)
    result.setflags(write=False)
    return result


def single(name: str, size_m: tuple[float, float], border_m: float = 0.0) -> Float32Array:
    """Return a photograph cut to the shape of an area, in a pale frame of the given width."""
    width, height = _texels(size_m)
    photo = photograph(name)
    scale = max(width / photo.shape[1], height / photo.shape[0])
    columns, rows = min(photo.shape[1], round(width / scale)), min(photo.shape[0], round(height / scale))
    x, y = (photo.shape[1] - columns) // 2, (photo.shape[0] - rows) // 2
    picture = _resized(photo[y : y + rows, x : x + columns], (width, height))
    if border_m > 0:
        edge = max(1, round(border_m / TEXEL_M))
        picture[:edge] = picture[-edge:] = picture[:, :edge] = picture[:, -edge:] = 0.75
    return picture


def tiled(
    name: str,
    size_m: tuple[float, float],
    rng: np.random.Generator,
    *,
    tile_m: float,
    contrast: float,
    level: float,
) -> Float32Array:
    """Cover an area with mirrored copies of a photograph, with stains that no two places share.

    Parameters
    ----------
    name
        Name of the photograph.
    size_m
        Width and height of the area.
    rng
        Source of the stains.
    tile_m
        Edge of one copy.
    contrast
        Exponent on the reflectance relative to its geometric mean.
    level
        Geometric mean of the reflectance.
    """
    width, height = _texels(size_m)
    photo = photograph(name)
    edge = max(16, round(tile_m / TEXEL_M))
    tile = _resized(photo, (edge, edge))
    tile = level * np.exp(contrast * (np.log(tile) - np.mean(np.log(tile))))
    pair = np.hstack([tile, tile[:, ::-1]])
    block = np.vstack([pair, pair[::-1]])
    copies = (-(-height // block.shape[0]), -(-width // block.shape[1]))
    covered = np.tile(block, copies)[:height, :width] * stains((width, height), rng, 0.15)
    return np.clip(covered, _DARKEST, _BRIGHTEST).astype(np.float32)


def painted(size_m: tuple[float, float], rng: np.random.Generator, level: float) -> Float32Array:
    """Return an evenly painted area that is only a little stained."""
    size = _texels(size_m)
    even = np.clip(level * stains(size, rng, 0.08), _DARKEST, _BRIGHTEST)
    return np.asarray(even, dtype=np.float32)


def stains(size: tuple[int, int], rng: np.random.Generator, strength: float) -> Float32Array:
    """Return a smooth positive field around 1, structured from a hand's to an arm's size, shape (height, width)."""
    field = np.zeros((size[1], size[0]), np.float32)
    for cell_m, weight in ((0.6, 1.0), (0.2, 0.5), (0.07, 0.25)):
        rows, columns = (max(2, round(n * TEXEL_M / cell_m)) for n in (size[1], size[0]))
        coarse = rng.standard_normal((rows, columns)).astype(np.float32)
        field += np.float32(weight) * cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.exp(np.float32(strength) * field), dtype=np.float32)


def _texels(size_m: tuple[float, float]) -> tuple[int, int]:
    return max(16, round(size_m[0] / TEXEL_M)), max(16, round(size_m[1] / TEXEL_M))


def _resized(image: Float32Array, size: tuple[int, int]) -> Float32Array:
    shrink = size[0] < image.shape[1]
    resized = cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrink else cv2.INTER_CUBIC)
    return np.asarray(np.clip(resized, _DARKEST, _BRIGHTEST), dtype=np.float32)
