"""The vignette from images of a plane: Engel, Usenko and Cremers 2016, section "vignette calibration".

A Lambertian plane of unknown texture C is filmed from many sides. With known response, exposures and, for each image,
the place where every point of the plane is seen, C and V are found in turn from irradiances Iᵢ = tᵢ V(πᵢ(x)) C(x).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray, Image, ImageSize, IntArray
from ospc.errors import NotObservableError, SettingError
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette

_FEWEST_VIEWS = 3
_LEAST = 0.02
_OUTLIER = 15.0 / 255
"""Residual irradiance, of full scale, beyond which a sample is left out, as in the publication's program."""


@dataclass(frozen=True)
class PlaneView:
    """An image of the plane.

    Attributes
    ----------
    image
        Grey levels of 8 bit, shape (height, width).
    exposure_ms
        Its exposure.
    homography
        Takes (x, y, 1), x and y in [0, 1] on the plane, to homogeneous pixels, shape (3, 3).
    """

    image: Image
    exposure_ms: float
    homography: FloatArray


def marker_view(image: Image, exposure_ms: float, margin: float = 2.0) -> PlaneView | None:
    """Return a view of the plane that a printed ArUco marker lies on; None where the marker is not seen.

    Parameters
    ----------
    image
        Grey levels of 8 bit.
    exposure_ms
        Its exposure.
    margin
        How far the plane's used part reaches beyond the marker, in edges of the marker.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    corners, _, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(image)
    if len(corners) != 1:
        return None
    low, high = margin / (2 * margin + 1), (margin + 1) / (2 * margin + 1)
    place = np.array([[low, low], [high, low], [high, high], [low, high]], dtype=np.float32)
    return PlaneView(image, exposure_ms, cv2.getPerspectiveTransform(place, corners[0].reshape(4, 2)))


def plane_vignette(
    views: Sequence[PlaneView], response: Response, *, cells: int = 300, iterations: int = 20, smoothing: int = 3
) -> RasterVignette:
    """Return the vignette of the camera that took the views.

    Parameters
    ----------
    views
        Of one plane.
    response
        The camera's.
    cells
        Number of points of the plane along each axis.
    iterations
        Turns.
    smoothing
        Times that empty pixels are filled from their neighbours, at the end.

    Raises
    ------
    SettingError
        If there are fewer than three views, or their sizes differ.
    NotObservableError
        If the views leave most of the image without a sample.
    """
    if len(views) < _FEWEST_VIEWS or len({view.image.shape for view in views}) > 1:
        raise SettingError(f"a vignette needs {_FEWEST_VIEWS} views or more of one size; there are {len(views)}")
    height, width = views[0].image.shape
    samples = [_Sampled.of(view, response, cells) for view in views]
    mean = float(np.mean([view.exposure_ms for view in views]))
    attenuation: Float32Array = np.ones((height, width), np.float32)
    plane = np.zeros(cells**2)
    for turn in range(iterations):
        plane = _plane(samples, attenuation, plane, outliers=turn > 1, mean=mean)
        attenuation = _attenuation(samples, plane, (width, height), mean)
    filled = _filled(attenuation, smoothing)
    if np.mean(filled <= 0) > 0.5:
        raise NotObservableError("the views of the plane cover less than half of the image; move it about more")
    return RasterVignette(_whole(filled), {"name": "plane"})


@dataclass(frozen=True)
class _Sampled:
    """A view at the points of the plane that it sees: which, where, and their irradiance."""

    point: IntArray
    place: Float32Array
    irradiance: FloatArray
    exposure_ms: float

    @classmethod
    def of(cls, view: PlaneView, response: Response, cells: int) -> _Sampled:
        grid = (pixel_grid((cells, cells)).reshape(-1, 2) + 0.5) / cells
        projected = np.column_stack([grid, np.ones(len(grid))]) @ view.homography.T
        places = projected[:, :2] / np.where(np.abs(projected[:, 2:]) > 1e-9, projected[:, 2:], np.nan)
        height, width = view.image.shape
        with np.errstate(invalid="ignore"):
            seen = (projected[:, 2] > 0) & np.all((places >= 1) & (places <= [width - 2, height - 2]), axis=1)
        places32 = places[seen].astype(np.float32)
        table = response.resampled(256).astype(np.float32)
        light = _at(table[view.image], places32)
        saturated = _at((cv2.dilate(view.image, None) >= 255).astype(np.float32), places32) > 0
        kept = ~saturated
        return cls(np.flatnonzero(seen)[kept], places32[kept], light[kept], view.exposure_ms)


def _plane(
    samples: Sequence[_Sampled], attenuation: Float32Array, before: FloatArray, *, outliers: bool, mean: float
) -> FloatArray:
    """Return C = Σ tV·I / Σ (tV)², where wanted without the samples that the C before contradicts."""
    top, bottom = np.zeros_like(before), np.zeros_like(before)
    for s in samples:
        tv = s.exposure_ms / mean * _at(attenuation, s.place)
        used = tv > _LEAST * s.exposure_ms / mean
        if outliers:
            used &= np.abs(s.irradiance - tv * before[s.point]) < _OUTLIER
        top += np.bincount(s.point[used], weights=(tv * s.irradiance)[used], minlength=top.size)
        bottom += np.bincount(s.point[used], weights=(tv**2)[used], minlength=top.size)
    return np.asarray(np.where(bottom > 0, top / np.maximum(bottom, 1e-12), 0.0))


def _attenuation(samples: Sequence[_Sampled], plane: FloatArray, size: ImageSize, mean: float) -> Float32Array:
    """Return V = Σ tC·I / Σ (tC)², every sample shared among the four pixels around it; its maximum is one."""
    width, height = size
    top, bottom = np.zeros(width * height), np.zeros(width * height)
    for s in samples:
        tc = s.exposure_ms / mean * plane[s.point]
        x, y = np.floor(s.place).astype(np.int64).T
        dx, dy = (s.place - np.floor(s.place)).T.astype(np.float64)
        shares = (((1 - dx) * (1 - dy), 0), (dx * (1 - dy), 1), ((1 - dx) * dy, width), (dx * dy, width + 1))
        for share, offset in shares:
            at = y * width + x + offset
            top += np.bincount(at, weights=share * tc * s.irradiance, minlength=top.size)
            bottom += np.bincount(at, weights=share * tc**2, minlength=top.size)
    found = np.where(bottom > 0, top / np.maximum(bottom, 1e-12), 0.0).reshape(height, width)
    largest = float(np.quantile(found[found > 0], 0.995)) if np.any(found > 0) else 1.0
    return np.asarray(np.clip(found / largest, 0, 1), dtype=np.float32)


def _filled(image: Float32Array, times: int) -> Float32Array:
    """Return the image with empty pixels replaced by the mean of their known neighbours, several times."""
    for _ in range(times):
        known = (image > 0).astype(np.float32)
        around = cv2.boxFilter(known, -1, (5, 5), normalize=False)
        total = cv2.boxFilter(image * known, -1, (5, 5), normalize=False)
        image = np.where((known == 0) & (around > 0), total / np.maximum(around, 1), image).astype(np.float32)
    return image


def _whole(image: Float32Array) -> Float32Array:
    """Return the image with what is still empty taken from the mean at its radius, relative to the centre."""
    height, width = image.shape
    radius = np.linalg.norm(normalised(pixel_grid((width, height)), (width, height)), axis=-1)
    ring = np.minimum((radius * 50).astype(int), 49)
    known = image > 0
    sums = np.bincount(ring[known], weights=image[known], minlength=50)
    counts = np.bincount(ring[known], minlength=50)
    rings = np.flatnonzero(counts)
    profile = np.interp(np.arange(50), rings, sums[rings] / counts[rings])
    return np.where(known, image, profile[ring]).astype(np.float32)


def _at(image: Float32Array, places: Float32Array) -> FloatArray:
    if not len(places):
        return np.empty(0)
    x, y = np.ascontiguousarray(places.T, dtype=np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR).ravel(), dtype=np.float64)
