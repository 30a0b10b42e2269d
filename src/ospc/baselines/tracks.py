"""Feature tracks that survive exposure changes: the Lucas-Kanade method with one gain between two frames.

Kim, Frahm and Pollefeys ("Joint feature tracking and radiometric calibration from auto-exposure video", 2007) track
with a gain that all features of a frame share and that is estimated along with their displacements; Bergmann et al.
2018 use the same. Here displacements and gain are estimated in turn: frames are brought to equal brightness with the
gain at hand, features are tracked, the gain is estimated anew from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray, Image, ImageSize, IntArray
from ospc.photometry.geometry import normalised
from ospc.recording.frame import Frame

_PATTERN = np.array([(0, 0), (3, 0), (-3, 0), (0, 3), (0, -3)], dtype=np.float32)
"""Places within a feature's window, in pixels, that are scene points of their own."""

_RIGHT, _DOWN = np.array([1, 0], dtype=np.float32), np.array([0, 1], dtype=np.float32)

_ROUNDS = 2
_GAIN_CHANGE = 0.02
_BACK_PX = 0.7
_GRADIENT_SCALE = 12.0
"""Grey levels a pixel at which a sample's weight is one half: misplacement makes steep places unreliable."""


@dataclass(frozen=True)
class TrackObservations:
    """Scene points seen in several frames.

    Attributes
    ----------
    size
        Width and height of the frames.
    point
        Scene point of each observation, numbered from 0 without gaps, shape (n,).
    frame
        Position of its frame among :attr:`frames`, shape (n,).
    grey
        Grey level in [0, 1], shape (n,).
    radius
        Distance from the image centre, 1 at the corner, shape (n,).
    weight
        In (0, 1], shape (n,).
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
        """Return what was seen in frames of that index or a later one, of points seen there at least twice."""
        recent = self.frames[self.frame] >= index
        count = np.bincount(self.point[recent], minlength=int(self.point.max(initial=-1)) + 1)
        kept = recent & (count[self.point] >= 2)
        points, point = np.unique(self.point[kept], return_inverse=True)
        numbers, frame = np.unique(self.frame[kept], return_inverse=True)
        del points
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
    """Follows features from frame to frame.

    Parameters
    ----------
    features
        How many are followed at a time.
    window_px
        Edge of the windows that are compared.
    every
        Every how many frames observations are kept; tracking goes through all of them.
    """

    def __init__(self, features: int = 250, window_px: int = 21, every: int = 2) -> None:
        self._features = features
        self._window = (window_px, window_px)
        self._every = every
        self._previous: Image | None = None
        self._points: Float32Array = np.empty((0, 2), np.float32)
        self._track: IntArray = np.empty(0, np.int64)
        self._tracks = 0
        self._seen = 0
        self._rows: list[tuple[int, IntArray, FloatArray, FloatArray, FloatArray]] = []
        self._size: ImageSize = (0, 0)
        self.log_gain = 0.0
        """ln of the last frame's brightness over that of the one before."""

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        image = frame.image
        scaled = image if frame.max_grey == 255 else np.rint(image * (255 / frame.max_grey)).astype(np.uint8)
        self._size = (image.shape[1], image.shape[0])
        if self._previous is not None and len(self._points):
            self._follow(self._previous, scaled)
        if len(self._points) < 0.7 * self._features:
            self._detect(scaled)
        if self._seen % self._every == 0:
            self._keep(frame.index, scaled)
        self._previous = scaled
        self._seen += 1

    def observations(self) -> TrackObservations:
        """Return what was seen so far of points seen at least twice."""
        if not self._rows:
            empty = np.empty(0)
            none = np.empty(0, np.int64)
            return TrackObservations(self._size, none, none, empty, empty, empty, none)
        sizes = [row[1].size for row in self._rows]
        return TrackObservations(
            self._size,
            np.concatenate([row[1] for row in self._rows]),
            np.repeat(np.arange(len(sizes)), sizes),
            np.concatenate([row[2] for row in self._rows]),
            np.concatenate([row[3] for row in self._rows]),
            np.concatenate([row[4] for row in self._rows]),
            np.array([row[0] for row in self._rows], dtype=np.int64),
        ).since(0)

    def _follow(self, before: Image, after: Image) -> None:
        self.log_gain = log_brightness(after) - log_brightness(before)
        for _ in range(_ROUNDS):
            first, second = equalised(before, after, self.log_gain)
            moved, found, _ = cv2.calcOpticalFlowPyrLK(
                first, second, self._points, None, winSize=self._window, maxLevel=4
            )
            back, found_back, _ = cv2.calcOpticalFlowPyrLK(
                second, first, moved, None, winSize=self._window, maxLevel=4
            )
            good = (found.ravel() > 0) & (found_back.ravel() > 0)
            good &= np.linalg.norm(back - self._points, axis=1) < _BACK_PX
            if not good.any():
                break
            gain = _gain(before, after, self._points[good], moved[good])
            if abs(gain - self.log_gain) < _GAIN_CHANGE:
                break
            self.log_gain = gain
        inside = np.all((moved > 6) & (moved < np.array(self._size) - 7), axis=1)
        self._points, self._track = moved[good & inside], self._track[good & inside]

    def _detect(self, image: Image) -> None:
        mask = np.full(image.shape, 255, np.uint8)
        for x, y in self._points:
            cv2.circle(mask, (round(float(x)), round(float(y))), 12, 0, -1)
        wanted = self._features - len(self._points)
        # Equalised, so that dark parts of the image have features too.
        corners = cv2.goodFeaturesToTrack(cv2.equalizeHist(image), wanted, 0.005, 14, mask=mask)
        if corners is None:
            return
        new = corners.reshape(-1, 2).astype(np.float32)
        new = new[np.all((new > 6) & (new < np.array(self._size) - 7), axis=1)]
        self._points = np.concatenate([self._points, new])
        self._track = np.concatenate([self._track, self._tracks + np.arange(len(new))])
        self._tracks += len(new)

    def _keep(self, index: int, image: Image) -> None:
        places = (self._points[:, None] + _PATTERN).reshape(-1, 2)
        point = (self._track[:, None] * len(_PATTERN) + np.arange(len(_PATTERN))).ravel()
        smooth = cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32)
        grey = _sampled(smooth, places)
        across = _sampled(smooth, places + _RIGHT) - _sampled(smooth, places - _RIGHT)
        down = _sampled(smooth, places + _DOWN) - _sampled(smooth, places - _DOWN)
        steep = (across**2 + down**2) / 4
        exposed = (_sampled(cv2.dilate(image, None).astype(np.float32), places) < 254) & (grey > 1.5)
        radius = np.linalg.norm(normalised(places.astype(np.float64), self._size), axis=-1)
        weight = _GRADIENT_SCALE**2 / (_GRADIENT_SCALE**2 + steep)
        self._rows.append(
            (index, point[exposed], grey[exposed] / 255, np.asarray(radius[exposed]), np.asarray(weight[exposed]))
        )


def _sampled(image: Float32Array, places: Float32Array) -> FloatArray:
    if not len(places):
        return np.empty(0)
    x, y = np.ascontiguousarray(places.T, dtype=np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR).ravel(), dtype=np.float64)


def log_brightness(image: Image) -> float:
    """Return ln of the median grey level."""
    return float(np.log(max(float(np.median(image[::4, ::4])), 1.0)))


def equalised(before: Image, after: Image, log_gain: float) -> tuple[Image, Image]:
    """Return both frames at the brightness of the darker one."""
    if log_gain > 0:
        return before, cv2.convertScaleAbs(after, alpha=float(np.exp(-log_gain)))
    return cv2.convertScaleAbs(before, alpha=float(np.exp(log_gain))), after


def _gain(before: Image, after: Image, places: Float32Array, moved: Float32Array) -> float:
    """Return the median over features of ln of their brightness after over before."""
    first, second = (
        _sampled(cv2.blur(image, (7, 7)).astype(np.float32), p) for image, p in ((before, places), (after, moved))
    )
    exposed = (first > 3) & (second > 3) & (first < 245) & (second < 245)
    return float(np.median(np.log(second[exposed] / first[exposed]))) if exposed.any() else 0.0
