"""Tracks of the same points through raw and corrected frames, with their survival and brightness residuals."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import BoolArray, Float32Array, FloatArray, IntArray
from ospc.evaluation.corrected_frames import CorrectedFrames
from ospc.evaluation.lucas_kanade import LOSSES, WINDOW_PX, follow, in_contrasts, windows
from ospc.evaluation.streams import LifeTable, StreamingMedian
from ospc.photometry.correction import Corrector
from ospc.recording import Frame

KINDS = ("raw", "corrected")
CAUSES = (*LOSSES, "too bright or dark")
"""Causes that end a track: the point is lost from one frame to the next, or its brightness differs from that at the
start, so that a method which compares brightness with the first frame cannot track it."""

EVERY = 15
"""Frames from one in which tracks start to the next."""

_POINTS = 150
"""Most tracks that start in one frame."""

_HORIZON = 60
"""Frames after which a track is no longer followed; few points stay in view for longer."""

_MAX_CHANGE = 0.5
"""Largest change of a window's mean grey level since its track began, in units of the contrast within it."""

_QUALITY, _DISTANCE_PX, _BLOCK_PX = 0.01, 10.0, 7
"""Detection of corners: least response relative to the best (Shi and Tomasi 1994), least distance between points,
side of the block in which the response is computed."""


@dataclass(frozen=True)
class TrackFigures:
    """Statistics of the tracks in one kind of frames.

    Attributes
    ----------
    steps
        Attempts to track a point to the next frame.
    lost
        Number of failures by cause, see :data:`CAUSES`.
    mean_life
        Mean life in frames, including the first, of tracks followed for at most ``horizon`` frames.
    median_life
        Frames that half of the tracks do not outlive; None if more than half outlive the horizon.
    residual
        Median over tracks and frames of the brightness residual: the change of the window's mean grey level since the
        track began over the contrast (mean absolute deviation) within the window; NaN without any.
    """

    steps: int
    lost: dict[str, int]
    mean_life: float
    median_life: int | None
    residual: float


class Tracks:
    """Tracks that start at the same points in raw frames, and in frames corrected with a response and vignette."""

    def __init__(self, corrector: Corrector) -> None:
        self._max_grey = corrector.max_grey
        self._corrected = CorrectedFrames(corrector)
        self._lives = [LifeTable(_HORIZON) for _ in KINDS]
        self._lost = [np.zeros(len(CAUSES), np.int64) for _ in KINDS]
        self._residuals = [StreamingMedian() for _ in KINDS]
        self._places = np.empty((len(KINDS), 0, 2))
        self._alive = np.empty((len(KINDS), 0), np.bool_)
        self._age = np.empty(0, np.int64)
        self._first_grey = np.empty((0, WINDOW_PX**2))
        self._first_radiance = np.empty((0, WINDOW_PX**2))
        self.begun = 0

    def begin(self, frame: Frame) -> None:
        """Start tracks at the corners of a raw frame that are not saturated."""
        image = frame.image_8_bit
        usable = cv2.erode((frame.image < self._max_grey).view(np.uint8), np.ones((WINDOW_PX, WINDOW_PX), np.uint8))
        found = cv2.goodFeaturesToTrack(image, _POINTS, _QUALITY, _DISTANCE_PX, mask=usable, blockSize=_BLOCK_PX)
        if found is None:
            return
        places = found.reshape(-1, 2).astype(np.float64)
        count = len(places)
        radiance = self._corrected.radiance(frame)
        self._places = np.concatenate([self._places, np.stack([places] * len(KINDS))], axis=1)
        self._alive = np.concatenate([self._alive, np.ones((len(KINDS), count), np.bool_)], axis=1)
        self._age = np.concatenate([self._age, np.zeros(count, np.int64)])
        self._first_grey = np.concatenate([self._first_grey, windows(image, places)])
        self._first_radiance = np.concatenate([self._first_radiance, windows(radiance, places)])
        self.begun += count

    def follow(self, before: Frame, after: Frame) -> None:
        """Continue all tracks from one frame to the next."""
        self._alive &= self._inside(before) & (self._age < _HORIZON)
        radiance = self._corrected.radiance(after)
        pairs = ((before.image_8_bit, after.image_8_bit), self._corrected.pair(before, after))
        for kind, images in enumerate(pairs):
            index = np.flatnonzero(self._alive[kind])
            step = follow(*images, self._places[kind, index])
            change = self._changes(kind, after, radiance, index, step.places)
            changed = step.followed & (change > _MAX_CHANGE)
            followed = step.followed & ~changed
            self._lives[kind].add(self._age[index], self._age[index[~followed]])
            self._lost[kind] += np.append(step.losses.sum(axis=1), changed.sum())
            self._places[kind, index] = step.places
            self._alive[kind, index] = followed
        self._age += 1
        self._compare_with_first(after, radiance)
        kept = self._alive.any(axis=0)
        self._places, self._alive, self._age = self._places[:, kept], self._alive[:, kept], self._age[kept]
        self._first_grey, self._first_radiance = self._first_grey[kept], self._first_radiance[kept]

    def figures(self) -> tuple[TrackFigures, TrackFigures, int]:
        """Return the statistics of raw and of corrected frames, and the age up to which both are known."""
        horizon = min(life.horizon for life in self._lives)
        raw, corrected = (
            TrackFigures(
                life.steps,
                dict(zip(CAUSES, lost.tolist(), strict=True)),
                life.mean_life(horizon),
                life.median_life(horizon),
                residual.value,
            )
            for life, lost, residual in zip(self._lives, self._lost, self._residuals, strict=True)
        )
        return raw, corrected, horizon

    def _inside(self, frame: Frame) -> BoolArray:
        """Return which places are at least a window's side from the border, shape (2, n)."""
        far = np.array(frame.image.shape[::-1]) - 1 - WINDOW_PX
        return np.asarray(np.all((self._places >= WINDOW_PX) & (self._places <= far), axis=-1))

    def _compare_with_first(self, frame: Frame, radiance: Float32Array) -> None:
        """Add the brightness residuals of both kinds, computed at the same places."""
        alive = self._alive & self._inside(frame)
        index = np.flatnonzero(alive.any(axis=0))
        places = np.where(alive[1, index, None], self._places[1, index], self._places[0, index])
        for kind, residual in enumerate(self._residuals):
            residual.add(self._changes(kind, frame, radiance, index, places))

    def _changes(
        self, kind: int, frame: Frame, radiance: Float32Array, index: IntArray, places: FloatArray
    ) -> FloatArray:
        """Return the brightness residuals of tracks at places, in frames of one kind; NaN if saturated."""
        changes = np.full(index.size, np.nan)
        if not index.size:
            return changes
        now, first = windows(radiance, places), self._first_radiance[index]
        exposed = np.isfinite(now).all(axis=1) & np.isfinite(first).all(axis=1)
        if KINDS[kind] == "raw":
            grey = windows(frame.image_8_bit, places)
            changes[exposed] = _residual(self._first_grey[index[exposed]], grey[exposed])
        else:
            both = [self._corrected.greys(values[exposed], frame.exposure_ms) for values in (first, now)]
            changes[exposed] = _residual(*both)
        return changes


def _residual(first: FloatArray, now: FloatArray) -> FloatArray:
    """Return the change of brightness in units of the contrast, shape (n, pixels) twice -> (n,)."""
    return in_contrasts(np.abs(now.mean(axis=1) - first.mean(axis=1)), first, now)
