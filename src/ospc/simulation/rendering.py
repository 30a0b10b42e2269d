"""Render the radiance at every pixel from a scene and a pose.

Each flat surface is mapped by a homography. A pixel samples the texture pyramid at the level whose texels are as
large as its footprint, blended between the two nearest levels. This averages fine texture over the area of the pixel
and avoids aliasing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import Float32Array, FloatArray, ImageSize
from ospc.simulation.scene import Scene
from ospc.simulation.surface import Face, Rectangle, Solid

_NEAR_M = 0.02
"""Distance of the near clipping plane, in metres; nothing comes nearer than 0.2 m."""
_MARGIN_PX = 2.0
"""Margin around the image within which surfaces are kept, in pixels, because their antialiased edges extend half a
pixel."""
_CELL_PX = 32
"""Edge of the cells, in pixels, on which the level of detail is computed before it is interpolated."""


@dataclass(frozen=True)
class View:
    """A pinhole camera and its pose."""

    size: ImageSize
    """Width and height of its image in pixels."""
    focal_px: float
    """Focal length in pixels. The principal point is the image centre; the first pixel is centred at (0, 0)."""
    position_m: FloatArray
    """World position, shape (3,)."""
    rotation: FloatArray
    """Camera-to-world rotation, shape (3, 3)."""

    def homography(self, place: Rectangle) -> FloatArray:
        """Return the map from metres (across, down, 1) on a rectangle to homogeneous pixels, shape (3, 3)."""
        columns = np.column_stack([place.across, place.down, place.corner_m - self.position_m])
        return np.asarray(self.projection @ columns)

    @cached_property
    def projection(self) -> FloatArray:
        """Map from world directions to homogeneous pixels, shape (3, 3)."""
        x, y = (self.size[0] - 1) / 2, (self.size[1] - 1) / 2
        intrinsics = np.array([[self.focal_px, 0.0, x], [0.0, self.focal_px, y], [0.0, 0.0, 1.0]])
        return np.asarray(intrinsics @ self.rotation.T)

    @cached_property
    def half_spaces(self) -> FloatArray:
        """Bounds of the view with its margin: rows (a, b, c, d) with a·x + b·y + c·w + d >= 0 inside."""
        right, bottom = self.size[0] - 1 + _MARGIN_PX, self.size[1] - 1 + _MARGIN_PX
        return np.array(
            [
                [0.0, 0.0, 1.0, -_NEAR_M],
                [1.0, 0.0, _MARGIN_PX, 0.0],
                [-1.0, 0.0, right, 0.0],
                [0.0, 1.0, _MARGIN_PX, 0.0],
                [0.0, -1.0, bottom, 0.0],
            ]
        )


def radiance(scene: Scene, view: View, time_s: float) -> Float32Array:
    """Return the radiance at every pixel in saturations per millisecond, shape (height, width), float32."""
    width, height = view.size
    canvas = np.zeros((height, width), np.float32)
    covered = np.zeros((height, width), np.float32)
    for face in scene.walls:
        for area, colour, alpha in _pieces(face, view):
            canvas[area] += colour * alpha
            covered[area] += alpha
    # Neighbouring walls share the pixels of their common edge: divide by their total coverage.
    canvas /= np.maximum(covered, np.float32(1e-3))
    for faces in _back_to_front(scene, view, time_s):
        # Faces of one body also share pixels: each replaces its share of the background, not the other face.
        pieces = [piece for face in faces for piece in _pieces(face, view)]
        changes = [(area, (colour - canvas[area]) * alpha) for area, colour, alpha in pieces]
        for area, change in changes:
            canvas[area] += change
    canvas *= np.float32(scene.scale)
    return canvas


def _back_to_front(scene: Scene, view: View, time_s: float) -> Iterable[tuple[Face, ...]]:
    """Yield pictures, the visible faces of each solid, and patches, from back to front."""
    # Solids are sorted by the power of the camera's position with respect to their bounding spheres, d² − r². The
    # powers of two spheres are equal on their radical plane, which separates the bodies, so the body on the camera's
    # side is nearer.
    yield from ((picture,) for picture in scene.pictures)

    def power(solid: Solid) -> float:
        return float(np.sum((solid.centre_m - view.position_m) ** 2)) - solid.radius_m**2

    for solid in sorted(scene.solids, key=power, reverse=True):
        yield tuple(f for f in solid.faces if f.place.normal @ (view.position_m - f.place.corner_m) > 0)
    yield from ((patch.at(time_s),) for patch in scene.patches)


_Piece = tuple[tuple[slice, slice], Float32Array, Float32Array]


def _pieces(face: Face, view: View) -> Iterable[_Piece]:
    """Yield the image area of a face, its radiance there, and the share of each pixel that it covers."""
    to_image = view.homography(face.place)
    outline = _outline(face.place.size_m, to_image, view.half_spaces)
    if outline is None:
        return
    x0, y0 = np.maximum(np.floor(outline.min(axis=0)), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(outline.max(axis=0)) + 1, view.size).astype(int)
    if x1 <= x0 or y1 <= y0:
        return
    shape = (int(y1 - y0), int(x1 - x0))
    to_metres = np.linalg.inv(to_image) @ np.array([[1.0, 0, x0], [0, 1, y0], [0, 0, 1]])
    colour = _sampled(face, to_metres, shape, outline - (x0, y0))
    yield (slice(y0, y1), slice(x0, x1)), colour, _coverage(face.place.size_m, to_metres, shape)


def _coverage(size_m: tuple[float, float], to_metres: FloatArray, shape: tuple[int, int]) -> Float32Array:
    """Return the share of each pixel that a rectangle covers, shape ``shape``."""
    # The share at an edge is the signed distance of the pixel's centre plus one half, clipped to [0, 1]. This is
    # exact for edges along rows or columns, and the shares of two faces with a common edge always add up to one.
    height, width = shape
    alpha = np.ones(shape, np.float32)
    across, down, depth = to_metres
    for edge in (across, size_m[0] * depth - across, down, size_m[1] * depth - down):
        a, b, c = (edge / max(float(np.hypot(edge[0], edge[1])), 1e-12)).tolist()
        if min(0.0, a * (width - 1)) + min(0.0, b * (height - 1)) + c < 0.5:
            x = (a * np.arange(width) + c + 0.5).astype(np.float32)
            y = (b * np.arange(height)).astype(np.float32)
            share = np.add.outer(y, x)
            alpha *= np.clip(share, 0, 1, out=share)
    return alpha


def _outline(size_m: tuple[float, float], to_image: FloatArray, half_spaces: FloatArray) -> FloatArray | None:
    """Return the corners in pixels of a rectangle clipped to the view, shape (n, 2); None if out of view."""
    w, h = size_m
    polygon = (np.array([[0, 0, 1], [w, 0, 1], [w, h, 1], [0, h, 1.0]]) @ to_image.T).tolist()
    for a, b, c, d in half_spaces.tolist():
        kept: list[list[float]] = []
        signed = [a * p[0] + b * p[1] + c * p[2] + d for p in polygon]
        for i, (p, s) in enumerate(zip(polygon, signed, strict=True)):
            q, t = polygon[i - 1], signed[i - 1]
            if (s >= 0) != (t >= 0):
                share = t / (t - s)
                kept.append([qi + share * (pi - qi) for pi, qi in zip(p, q, strict=True)])
            if s >= 0:
                kept.append(p)
        if len(kept) < 3:
            return None
        polygon = kept
    points = np.array(polygon)
    return np.asarray(points[:, :2] / points[:, 2:])


def _sampled(face: Face, to_metres: FloatArray, shape: tuple[int, int], outline: FloatArray) -> Float32Array:
    """Return the radiance of a face over an area of the image, blended between pyramid levels, shape ``shape``."""
    height, width = shape
    rows, columns = max(2, -(-height // _CELL_PX)), max(2, -(-width // _CELL_PX))
    x = (np.arange(columns) + 0.5) * width / columns - 0.5
    y = (np.arange(rows) + 0.5) * height / rows - 0.5
    points = np.concatenate([outline, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)])
    texel_m = face.place.size_m[0] / face.mips[0].shape[1]
    detail = np.minimum(np.maximum(_detail(to_metres, points, texel_m), 0), len(face.mips) - 1)
    bounds, detail = detail[: len(outline)], detail[len(outline) :].reshape(rows, columns)
    detail = np.minimum(np.maximum(detail, bounds.min()), bounds.max())
    first, final = math.floor(detail.min()), math.ceil(detail.max())
    if first == final:
        return _warped(face, first, to_metres, (0, 0), shape)
    total = np.zeros(shape, np.float32)
    for level in range(first, final + 1):
        weight = np.maximum(0, 1 - np.abs(detail - level)).astype(np.float32)
        if weight.max() > 0:
            # Warp only where this level has weight; interpolation extends it by one cell.
            (y0, y1), (x0, x1) = (
                _span(np.flatnonzero(weight.max(axis=1 - axis) > 0), weight.shape[axis], shape[axis])
                for axis in (0, 1)
            )
            share = cv2.resize(weight, (width, height), interpolation=cv2.INTER_LINEAR)[y0:y1, x0:x1]
            total[y0:y1, x0:x1] += share * _warped(face, level, to_metres, (x0, y0), (y1 - y0, x1 - x0))
    return total


def _span(used: npt.NDArray[np.intp], cells: int, pixels: int) -> tuple[int, int]:
    """Return the pixel range of a run of cells, with one more cell on either side."""
    return max(0, (used[0] - 1) * pixels // cells), min(pixels, -(-(int(used[-1]) + 2) * pixels // cells))


def _detail(to_metres: FloatArray, points: FloatArray, texel_m: float) -> FloatArray:
    """Return the pyramid level whose texels are as long as the footprint of a pixel, shape (n, 2) -> (n,)."""
    # The length of the footprint is the larger singular value of the derivative of the homography.
    p = points[:, :1] * to_metres[:, 0] + points[:, 1:] * to_metres[:, 1] + to_metres[:, 2]
    depth = p[:, 2:]
    depth = np.where(np.abs(depth) > 1e-9, depth, 1e-9)
    place = p[:, :2] / depth
    ux, vx = ((to_metres[:2, 0] - place * to_metres[2, 0]) / depth).T
    uy, vy = ((to_metres[:2, 1] - place * to_metres[2, 1]) / depth).T
    squares = ux**2 + uy**2 + vx**2 + vy**2
    determinant = ux * vy - uy * vx
    longest = np.sqrt((squares + np.sqrt(np.maximum(squares**2 - 4 * determinant**2, 0))) / 2)
    return np.asarray(np.log2(np.maximum(longest / texel_m, 1e-9)))


def _warped(
    face: Face, level: int, to_metres: FloatArray, first: tuple[int, int], shape: tuple[int, int]
) -> Float32Array:
    """Return one level of a face's pyramid, warped to an image area of ``shape`` that starts at pixel ``first``."""
    mip = face.mips[level]
    across, down = mip.shape[1] / face.place.size_m[0], mip.shape[0] / face.place.size_m[1]
    to_elements = np.array([[across, 0, -0.5], [0, down, -0.5], [0, 0, 1.0]]) @ to_metres
    to_elements = to_elements @ np.array([[1.0, 0, first[0]], [0, 1, first[1]], [0, 0, 1]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(mip, to_elements, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cv2.patchNaNs(warped)  # NaN occurs on the horizon of the plane, where the face covers nothing
    return np.asarray(warped, dtype=np.float32)
