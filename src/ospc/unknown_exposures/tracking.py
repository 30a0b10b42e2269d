"""Feature tracks that survive exposure changes: the Lucas-Kanade method with one gain between two frames.

Kim, Frahm and Pollefeys ("Joint feature tracking and radiometric calibration from auto-exposure video", 2007) track
with a gain that all features of a frame share, estimated together with their displacements; Bergmann et al. 2018 do
the same. Here displacements and gain are estimated alternately: the frames are equalised with the current gain,
features are tracked, and the gain is estimated from them again.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image, ImageSize, IntArray
from ospc.correspondence.point_tracking import track_and_return
from ospc.correspondence.thumbnail_registration import values_at
from ospc.photometry.geometry import normalised
from ospc.recording.frame import Frame
from ospc.settings.unknown_exposures import (
    BRIGHTEST_GAIN_8_BIT,
    BRIGHTEST_TRACKED_8_BIT,
    DARKEST_GAIN_8_BIT,
    DARKEST_TRACKED_8_BIT,
    FEATURE_QUALITY,
    FEATURE_SPACING_PX,
    GAIN_SIDE_PX,
    MAX_GAIN_ROUNDS,
    MAX_TRACK_RETURN_PX,
    MEDIAN_STEP_PX,
    MIN_GAIN_CHANGE,
    OBSERVED_OFFSETS_PX,
    OCCUPIED_PX,
    PYRAMID_LEVELS,
    REFILL_SHARE,
    TRACKED_FEATURES,
    TRACKED_GRADIENT_SCALE,
    TRACKED_SMOOTHING_PX,
    TRACKING_MARGIN_PX,
    TRACKING_WINDOW_PX,
)

_RIGHT, _DOWN = np.array([1, 0], dtype=np.float32), np.array([0, 1], dtype=np.float32)
"""Steps of one pixel, (x, y), for computing gradients."""


@dataclass(frozen=True)
class TrackObservations:
    """Grey levels of scene points in several frames, n observations.

    Attributes
    ----------
    size
        Width and height of the frames.
    point, frame
        Scene point of each observation, numbered from 0 without gaps, and index of its frame in :attr:`frames`,
        shape (n,).
    grey, radius, weight
        Grey level in [0, 1], distance from the image centre (1 at the corner), and weight in (0, 1], shape (n,).
    frames
        Indices of the frames in the recording, shape (frames,).
    """

    size: ImageSize
    point: IntArray
    frame: IntArray
    grey: FloatArray
    radius: FloatArray
    weight: FloatArray
    frames: IntArray

    def since(self, index: int) -> TrackObservations:
        """Return the observations in frames from this index on, for points with at least two of them."""
        recent = self.frames[self.frame] >= index
        count = np.bincount(self.point[recent], minlength=int(self.point.max(initial=-1)) + 1)
        kept = recent & (count[self.point] >= 2)
        _, point = np.unique(self.point[kept], return_inverse=True)
        numbers, frame = np.unique(self.frame[kept], return_inverse=True)
        return TrackObservations(
            self.size,
            point.astype(np.int64),
            frame.astype(np.int64),
            self.grey[kept],
            self.radius[kept],
            self.weight[kept],
            self.frames[numbers],
        )


class GainRobustTracker:
    """Tracks features between frames, and keeps the observations of every ``every``-th frame.

    Pixels outside the mask of a frame are not used.
    """

    def __init__(self, every: int = 2) -> None:
        self._every = every
        self._previous: Image | None = None
        self._usable: BoolArray | None = None
        self._points: Float32Array = np.empty((0, 2), np.float32)
        self._track: IntArray = np.empty(0, np.int64)
        self._tracks = 0
        self._count = 0
        self._rows: list[tuple[int, IntArray, FloatArray, FloatArray, FloatArray]] = []
        self._size: ImageSize = (0, 0)
        self.log_gain = 0.0
        """ln of the brightness ratio between the last frame and the previous one."""

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        image = frame.image_8_bit if frame.mask is None else _filled(frame.image_8_bit, frame.mask)
        self._usable = None if frame.mask is None else _far_from_unused(frame.mask)
        self._size = (image.shape[1], image.shape[0])
        if self._previous is not None and len(self._points):
            self._track_into(self._previous, image)
        if len(self._points) < REFILL_SHARE * TRACKED_FEATURES:
            self._detect(image)
        if self._count % self._every == 0:
            self._keep(frame.index, image)
        self._previous = image
        self._count += 1

    def observations(self) -> TrackObservations:
        """Return all observations so far, for points with at least two."""
        if not self._rows:
            empty, none = np.empty(0), np.empty(0, np.int64)
            return TrackObservations(self._size, none, none, empty, empty, empty, none)
        frames, point, grey, radius, weight = zip(*self._rows, strict=True)
        return TrackObservations(
            self._size,
            np.concatenate(point),
            np.repeat(np.arange(len(frames)), [part.size for part in point]),
            np.concatenate(grey),
            np.concatenate(radius),
            np.concatenate(weight),
            np.array(frames, dtype=np.int64),
        ).since(0)

    def _track_into(self, before: Image, after: Image) -> None:
        self.log_gain = log_brightness(after) - log_brightness(before)
        for _ in range(MAX_GAIN_ROUNDS):
            first, second = equalised(before, after, self.log_gain)
            moved, found, return_px = track_and_return(
                first, second, self._points, TRACKING_WINDOW_PX, PYRAMID_LEVELS
            )
            good = found & (return_px < MAX_TRACK_RETURN_PX)
            if not good.any():
                break
            gain = _gain(before, after, self._points[good], moved[good])
            if abs(gain - self.log_gain) < MIN_GAIN_CHANGE:
                break
            self.log_gain = gain
        kept = good & self._inside(moved)
        self._points, self._track = moved[kept], self._track[kept]

    def _detect(self, image: Image) -> None:
        mask = np.ones(image.shape, np.uint8) if self._usable is None else self._usable.astype(np.uint8)
        for x, y in self._points:
            cv2.circle(mask, (round(float(x)), round(float(y))), OCCUPIED_PX, 0, -1)
        wanted = TRACKED_FEATURES - len(self._points)
        # Histogram equalisation, so that dark parts of the image get features too.
        corners = cv2.goodFeaturesToTrack(
            cv2.equalizeHist(image), wanted, FEATURE_QUALITY, FEATURE_SPACING_PX, mask=mask
        )
        if corners is None:
            return
        new = corners.reshape(-1, 2).astype(np.float32)
        new = new[self._inside(new)]
        self._points = np.concatenate([self._points, new])
        self._track = np.concatenate([self._track, self._tracks + np.arange(len(new))])
        self._tracks += len(new)

    def _inside(self, places: Float32Array) -> BoolArray:
        far = np.array(self._size) - 1 - TRACKING_MARGIN_PX
        inside = np.asarray(np.all((places > TRACKING_MARGIN_PX) & (places < far), axis=1))
        if self._usable is not None:
            column, row = np.rint(places[inside]).astype(np.int64).T
            inside[inside] = self._usable[row, column]
        return inside

    def _keep(self, index: int, image: Image) -> None:
        places = (self._points[:, None] + OBSERVED_OFFSETS_PX).reshape(-1, 2)
        point = (self._track[:, None] * len(OBSERVED_OFFSETS_PX) + np.arange(len(OBSERVED_OFFSETS_PX))).ravel()
        smooth = cv2.GaussianBlur(image, (0, 0), TRACKED_SMOOTHING_PX).astype(np.float32)
        grey = sampled(smooth, places)
        across = sampled(smooth, places + _RIGHT) - sampled(smooth, places - _RIGHT)
        down = sampled(smooth, places + _DOWN) - sampled(smooth, places - _DOWN)
        steep = (across**2 + down**2) / 4
        brightest = sampled(cv2.dilate(image, None).astype(np.float32), places)
        exposed = (brightest < BRIGHTEST_TRACKED_8_BIT) & (grey > DARKEST_TRACKED_8_BIT)
        radius = np.linalg.norm(normalised(places.astype(np.float64), self._size), axis=-1)
        weight = TRACKED_GRADIENT_SCALE**2 / (TRACKED_GRADIENT_SCALE**2 + steep)
        self._rows.append(
            (index, point[exposed], grey[exposed] / 255, np.asarray(radius[exposed]), np.asarray(weight[exposed]))
        )


def sampled(image: Float32Array, places: npt.ArrayLike) -> FloatArray:
    """Interpolate an image at pixels (x, y), shape (n, 2) -> (n,) or (n, channels); outside, it is zero."""
    return values_at(image, np.ascontiguousarray(places, dtype=np.float32), cv2.BORDER_CONSTANT).astype(np.float64)


def log_brightness(image: Image) -> float:
    """Return ln of the median grey level, at least 0."""
    return float(np.log(max(float(np.median(image[::MEDIAN_STEP_PX, ::MEDIAN_STEP_PX])), 1.0)))


def equalised(before: Image, after: Image, log_gain: float) -> tuple[Image, Image]:
    """Return both frames scaled to the brightness of the darker one."""
    if log_gain > 0:
        return before, cv2.convertScaleAbs(after, alpha=float(np.exp(-log_gain)))
    return cv2.convertScaleAbs(before, alpha=float(np.exp(log_gain))), after


def _gain(before: Image, after: Image, places: Float32Array, moved: Float32Array) -> float:
    """Return the median over features of the ln brightness ratio of the second to the first frame."""
    first, second = (
        sampled(cv2.blur(image, (GAIN_SIDE_PX, GAIN_SIDE_PX)).astype(np.float32), p)
        for image, p in ((before, places), (after, moved))
    )
    exposed = (np.minimum(first, second) > DARKEST_GAIN_8_BIT) & (np.maximum(first, second) < BRIGHTEST_GAIN_8_BIT)
    return float(np.median(np.log(second[exposed] / first[exposed]))) if exposed.any() else 0.0


def _filled(image: Image, mask: BoolArray) -> Image:
    """Return the image with the median of the used pixels in place of all others, which must not be tracked."""
    median = float(np.median(image[mask])) if mask.any() else 0.0
    return np.where(mask, image, np.uint8(median))


def _far_from_unused(mask: BoolArray) -> BoolArray:
    side = 2 * TRACKING_MARGIN_PX + 1
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
