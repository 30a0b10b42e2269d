"""Reflectance of surfaces, synthesised from the photographs in the package."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray, read_only

TEXEL_M = 0.004
"""Edge of a texel in metres: the footprint of a pixel of a 640-pixel-wide camera at about 1.7 m."""
_DARKEST, _BRIGHTEST = 0.015, 0.93
"""Reflectance of black paint and white plaster."""
_FRAME = 0.75
"""Reflectance of picture frames."""
_STAINED, _PAINT_STAINED = 0.15, 0.08
"""Standard deviation of ln reflectance due to the largest stains, on rough surfaces and on paint."""
_STAINS = ((0.6, 1.0), (0.2, 0.5), (0.07, 0.25))
"""Size in metres and relative strength of the stains, from an arm's length to a hand's width."""
_GRAIN_CONTRAST, _GRAIN_TEXELS = 0.3, 256
"""Contrast and size of the gravel texture that adds a non-repeating grain to tiled surfaces."""


@lru_cache(maxsize=8)
def photograph(name: str) -> Float32Array:
    """Return one of the package's photographs as a read-only array of linear reflectance in (0, 1)."""
    content = (files("ospc.simulation") / "textures" / f"{name}.png").read_bytes()
    coded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    linear = srgb_decoded(np.asarray(coded, dtype=np.float64) / 255)
    return read_only((_DARKEST + (_BRIGHTEST - _DARKEST) * linear).astype(np.float32))


def srgb_decoded(grey: FloatArray) -> FloatArray:
    """Return the linear light of sRGB grey levels (IEC 61966-2-1)."""
    return np.where(grey <= 0.04045, grey / 12.92, ((grey + 0.055) / 1.055) ** 2.4)


def single(name: str, size_m: tuple[float, float], border_m: float = 0.0) -> Float32Array:
    """Return a photograph cropped to the aspect ratio of an area, with a pale frame of the given width."""
    width, height = _texels(size_m)
    photo = photograph(name)
    scale = max(width / photo.shape[1], height / photo.shape[0])
    columns, rows = min(photo.shape[1], round(width / scale)), min(photo.shape[0], round(height / scale))
    x, y = (photo.shape[1] - columns) // 2, (photo.shape[0] - rows) // 2
    picture = _resized(photo[y : y + rows, x : x + columns], (width, height))
    if border_m > 0:
        edge = max(1, round(border_m / TEXEL_M))
        picture[:edge] = picture[-edge:] = picture[:, :edge] = picture[:, -edge:] = _FRAME
    return picture


def tiled(
    name: str, size_m: tuple[float, float], rng: np.random.Generator, *, edge_m: float, contrast: float, level: float
) -> Float32Array:
    """Cover an area with mirrored copies of a photograph, for patterns that also repeat in reality.

    Non-repeating grain and stains are added. ``edge_m`` is the edge of one copy, ``contrast`` a factor on the
    logarithm of the reflectance relative to its mean, and ``level`` the geometric mean of the reflectance.
    """
    width, height = _texels(size_m)
    edge = max(16, round(edge_m / TEXEL_M))
    tile = _log_contrast(_resized(photograph(name), (edge, edge)))
    pair = np.hstack([tile, tile[:, ::-1]])
    block = np.vstack([pair, pair[::-1]])
    copies = (-(-height // block.shape[0]), -(-width // block.shape[1]))
    covered = np.float32(contrast) * np.tile(block, copies)[:height, :width]
    covered += np.float32(_GRAIN_CONTRAST) * _strewn("gravel", (width, height), rng, _GRAIN_TEXELS)
    return _coated(covered, level, rng, _STAINED)


def strewn(
    name: str, size_m: tuple[float, float], rng: np.random.Generator, *, edge_m: float, contrast: float, level: float
) -> Float32Array:
    """Cover an area with overlapping random pieces of a photograph of loose material, without repetition.

    Parameters are the same as for :func:`tiled`; ``edge_m`` is the edge of the whole photograph.
    """
    covered = np.float32(contrast) * _strewn(name, _texels(size_m), rng, max(32, round(edge_m / TEXEL_M)))
    return _coated(covered, level, rng, _STAINED)


def painted(size_m: tuple[float, float], rng: np.random.Generator, level: float) -> Float32Array:
    """Return an evenly painted area with faint stains."""
    width, height = _texels(size_m)
    return _coated(np.zeros((height, width), np.float32), level, rng, _PAINT_STAINED)


def _coated(log_contrast: Float32Array, level: float, rng: np.random.Generator, stained: float) -> Float32Array:
    """Return reflectance at a level, with smooth stains whose geometric mean is about 1, shape (height, width)."""
    height, width = log_contrast.shape
    stains = np.zeros((height, width), np.float32)
    for cell_m, weight in _STAINS:
        rows, columns = (max(2, round(side * TEXEL_M / cell_m)) for side in (height, width))
        coarse = rng.standard_normal((rows, columns)).astype(np.float32)
        stains += np.float32(weight) * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    reflectance = np.float32(level) * np.exp(log_contrast)
    stains *= np.float32(stained)
    reflectance *= np.exp(stains, out=stains)
    return np.clip(reflectance, _DARKEST, _BRIGHTEST, out=reflectance)


def _log_contrast(reflectance: Float32Array) -> Float32Array:
    log = np.log(reflectance)
    return np.asarray(log - np.mean(log), dtype=np.float32)


def _strewn(name: str, size: tuple[int, int], rng: np.random.Generator, edge: int) -> Float32Array:
    """Blend overlapping random pieces of a photograph's log contrast, shape (height, width)."""
    # A weighted mean of independent pieces would lose contrast. Dividing by the root of the sum of squared weights,
    # instead of the sum of weights, preserves the variance of the photograph.
    source = _log_contrast(_resized(photograph(name), (edge, edge)))
    piece = edge // 2
    ramp = np.sin(np.pi * (np.arange(piece, dtype=np.float32) + 0.5) / piece)
    window = np.outer(ramp, ramp).astype(np.float32)
    squared_window = window**2
    step = max(1, piece // 2)
    rows, columns = size[1] // step + 2, size[0] // step + 2
    total = np.zeros(((rows + 1) * step + piece, (columns + 1) * step + piece), np.float32)
    squares = np.full(total.shape, 1e-6, np.float32)
    weighted = np.empty_like(window)
    for row in range(rows):
        for column in range(columns):
            y, x = rng.integers(0, edge - piece + 1, 2)
            cut = np.rot90(source[y : y + piece, x : x + piece], int(rng.integers(4)))
            dy, dx = rng.integers(0, step // 2 + 1, 2)
            top, left = row * step + dy, column * step + dx
            place = (slice(top, top + piece), slice(left, left + piece))
            total[place] += np.multiply(window, cut, out=weighted)
            squares[place] += squared_window
    kept = (slice(piece, piece + size[1]), slice(piece, piece + size[0]))
    return np.asarray(total[kept] / np.sqrt(squares[kept]), dtype=np.float32)


def _texels(size_m: tuple[float, float]) -> tuple[int, int]:
    return max(16, round(size_m[0] / TEXEL_M)), max(16, round(size_m[1] / TEXEL_M))


def _resized(image: Float32Array, size: tuple[int, int]) -> Float32Array:
    shrink = size[0] < image.shape[1]
    resized = cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrink else cv2.INTER_CUBIC)
    return np.asarray(np.clip(resized, _DARKEST, _BRIGHTEST), dtype=np.float32)
