"""Tracks of the same points through raw and corrected frames, with survival and brightness residuals."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image, IntArray
from ospc.evaluation.lucas_kanade import LOSSES, follow, in_contrasts, windows
from ospc.numerics.robust import weighted_median
from ospc.photometry.correction import Corrector
from ospc.photometry.look_up import look_up
from ospc.photometry.response import Response
from ospc.recording import Frame
from ospc.settings.evaluation import (
    CORNER_BLOCK_PX,
    CORNER_DISTANCE_PX,
    CORNER_QUALITY,
    MAX_BRIGHTNESS_CHANGE,
    MAX_STARTED_TRACKS,
    MEDIAN_BINS,
    MEDIAN_HIGHEST,
    MEDIAN_LOWEST,
    MIN_HEADROOM,
    TRACK_HORIZON_FRAMES,
    WINDOW_PX,
)


class LifeTable:
    """Counts of tracks at risk and lost at every age up to a horizon.

    Survival is the product-limit estimate (Kaplan and Meier 1958): a censored track, such as one that leaves the
    image, counts until then, and afterwards neither as lost nor as alive.
    """

    def __init__(self, horizon: int) -> None:
        self._at_risk = np.zeros(horizon, np.int64)
        self._lost = np.zeros(horizon, np.int64)

    def add(self, ages: IntArray, lost_ages: IntArray) -> None:
        """Count a step of tracks by their ages before it, all below the horizon, and the ages of those lost in it."""
        self._at_risk += np.bincount(ages, minlength=len(self._at_risk))
        self._lost += np.bincount(lost_ages, minlength=len(self._lost))

    @property
    def steps(self) -> int:
        """Number of steps counted."""
        return int(self._at_risk.sum())

    @property
    def horizon(self) -> int:
        """Age up to which survival is known: the requested one, unless all tracks were censored before."""
        unknown = np.flatnonzero((self._at_risk == 0) & (self.survival[:-1] > 0))
        return int(unknown[0]) if unknown.size else len(self._at_risk)

    @property
    def survival(self) -> FloatArray:
        """Share alive at the ages 0, 1, … horizon, shape (horizon + 1,); the first is 1."""
        kept = 1 - self._lost / np.maximum(self._at_risk, 1)
        return np.concatenate([[1.0], np.cumprod(kept)])

    def mean_life(self, horizon: int) -> float:
        """Return the mean age reached, counted from 1, of tracks followed to an age of at most ``horizon``."""
        return float(self.survival[:horizon].sum())

    def median_life(self, horizon: int) -> int | None:
        """Return the median age reached, counted from 1; None if more than half outlive the horizon."""
        gone = np.flatnonzero(self.survival[: horizon + 1] <= 0.5)
        return int(gone[0]) if gone.size else None


class StreamingMedian:
    """A streaming median: counts in logarithmic bins from 10⁻⁵ to 10⁴, accurate to a quarter of a per cent."""

    def __init__(self) -> None:
        self._edges = np.geomspace(MEDIAN_LOWEST, MEDIAN_HIGHEST, MEDIAN_BINS + 1)
        self._counts = np.zeros(MEDIAN_BINS, np.int64)

    def add(self, values: FloatArray) -> None:
        """Count values; values out of range are clipped, non-finite values are ignored."""
        finite = values[np.isfinite(values)]
        self._counts += np.histogram(np.clip(finite, MEDIAN_LOWEST, MEDIAN_HIGHEST), self._edges)[0]

    @property
    def value(self) -> float:
        """The median; NaN if nothing was counted."""
        middles = np.sqrt(self._edges[:-1] * self._edges[1:])
        return weighted_median(middles, self._counts) if self._counts.any() else float("nan")


_LEVELS = 65536
"""Entries of the table from 16-bit irradiance to 8-bit grey values."""


class CorrectedFrames:
    """Frames as if recorded at another exposure and without vignette, f(s·g(M')/V).

    M' is the frame converted to that exposure. The factor s ≤ 1 provides headroom for the corrected corners, which
    can exceed white.
    """

    def __init__(self, corrector: Corrector) -> None:
        self._corrector = corrector
        self._response = corrector.response if isinstance(corrector.response, Response) else None
        darkest = 1.0 if corrector.vignette is None else float(corrector.vignette.image().min())
        self._headroom = min(max(darkest, MIN_HEADROOM), 1.0)
        self._greys = np.rint(255 * self._encoded(np.linspace(0.0, 1.0, _LEVELS))).astype(np.uint8)

    def radiance(self, frame: Frame) -> Float32Array:
        """Return the radiance at every pixel, NaN if saturated."""
        return np.asarray(self._corrector.correct(frame.image, frame.exposure_ms), dtype=np.float32)

    def greys(self, radiance: FloatArray, exposure_ms: float) -> FloatArray:
        """Return the grey values, 0 to 255, of radiances in corrected frames at an exposure."""
        return 255 * self._encoded(self._headroom * exposure_ms * radiance)

    def at_exposure(self, frame: Frame, exposure_ms: float) -> Image:
        """Return the corrected image of a frame at another exposure."""
        image = frame.image
        if exposure_ms != frame.exposure_ms:
            image = self._corrector.warp_exposure(image, frame.exposure_ms, exposure_ms)
        light = self._corrector.correct(image, dtype=np.uint16, white=1 / self._headroom, mark_saturated=False)
        return np.asarray(look_up(light, self._greys[:, None]))

    def _encoded(self, irradiance: FloatArray) -> FloatArray:
        if self._response is None:
            return np.clip(irradiance, 0.0, 1.0)
        return self._response(irradiance)


KINDS = ("raw", "corrected")
CAUSES = (*LOSSES, "different brightness")
"""Causes that end a track: the point is lost between frames, or its brightness differs too much from its first frame
for a method that compares with that frame."""


@dataclass(frozen=True)
class TrackFigures:
    """Statistics of the tracks in one kind of frames.

    Attributes
    ----------
    steps, lost
        Number of attempts to track a point to the next frame, and failures by cause, see :data:`CAUSES`.
    mean_life, median_life
        Mean and median life of tracks in frames, including the first, if followed for at most ``horizon`` frames; the
        median is None if more than half outlive the horizon.
    residual
        Median over tracks and frames of the brightness residual: the change of the window's mean grey level since the
        track began, divided by the contrast (mean absolute deviation) within the window; NaN if there is none.
    """

    steps: int
    lost: dict[str, int]
    mean_life: float
    median_life: int | None
    residual: float


class Tracks:
    """Tracks that start at the same points in raw frames, and in frames corrected with a response and vignette."""

    def __init__(self, corrector: Corrector) -> None:
        self._corrector = corrector
        self._corrected = CorrectedFrames(corrector)
        self._lives = [LifeTable(TRACK_HORIZON_FRAMES) for _ in KINDS]
        self._lost = [np.zeros(len(CAUSES), np.int64) for _ in KINDS]
        self._residuals = [StreamingMedian() for _ in KINDS]
        self._places = np.empty((len(KINDS), 0, 2))
        self._alive = np.empty((len(KINDS), 0), np.bool_)
        self._age = np.empty(0, np.int64)
        # Windows in the first frame of each track: grey levels and radiances.
        self._first = np.empty((len(KINDS), 0, WINDOW_PX**2))
        self.begun = 0

    def begin(self, frame: Frame) -> None:
        """Start tracks at the unsaturated corners of a raw frame."""
        image = frame.image_8_bit
        exposed = ~self._corrector.saturated(frame.image)
        usable = cv2.erode(exposed.view(np.uint8), np.ones((WINDOW_PX, WINDOW_PX), np.uint8))
        found = cv2.goodFeaturesToTrack(
            image, MAX_STARTED_TRACKS, CORNER_QUALITY, CORNER_DISTANCE_PX, mask=usable, blockSize=CORNER_BLOCK_PX
        )
        if found is None:
            return
        places = found.reshape(-1, 2).astype(np.float64)
        first = np.stack([windows(of, places) for of in (image, self._corrected.radiance(frame))])
        count = len(places)
        self._places = np.concatenate([self._places, np.stack([places] * len(KINDS))], axis=1)
        self._alive = np.concatenate([self._alive, np.ones((len(KINDS), count), np.bool_)], axis=1)
        self._first = np.concatenate([self._first, first], axis=1)
        self._age = np.concatenate([self._age, np.zeros(count, np.int64)])
        self.begun += count

    def follow(self, before: Frame, after: Frame) -> None:
        """Continue all tracks from one frame to the next."""
        self._alive &= self._inside(before) & (self._age < TRACK_HORIZON_FRAMES)
        radiance = self._corrected.radiance(after)
        longer_ms = max(before.exposure_ms, after.exposure_ms)
        first, second = (self._corrected.at_exposure(frame, longer_ms) for frame in (before, after))
        for kind, images in enumerate(((before.image_8_bit, after.image_8_bit), (first, second))):
            index = np.flatnonzero(self._alive[kind])
            there, losses = follow(*images, self._places[kind, index])
            change = self._changes(kind, after, radiance, index, there)
            changed = ~losses.any(axis=0) & (change > MAX_BRIGHTNESS_CHANGE)
            followed = ~(losses.any(axis=0) | changed)
            self._lives[kind].add(self._age[index], self._age[index[~followed]])
            self._lost[kind] += np.append(losses.sum(axis=1), changed.sum())
            self._places[kind, index] = there
            self._alive[kind, index] = followed
        self._age += 1
        self._compare_with_first(after, radiance)
        kept = self._alive.any(axis=0)
        self._places, self._alive = self._places[:, kept], self._alive[:, kept]
        self._first, self._age = self._first[:, kept], self._age[kept]

    def figures(self) -> tuple[TrackFigures, TrackFigures, int]:
        """Return the statistics of raw and corrected frames, and the age up to which both are known."""
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
        """Return which points are at least one window side from the border, shape (2, n)."""
        far = np.array(frame.image.shape[::-1]) - 1 - WINDOW_PX
        return np.asarray(np.all((self._places >= WINDOW_PX) & (self._places <= far), axis=-1))

    def _compare_with_first(self, frame: Frame, radiance: Float32Array) -> None:
        """Add the brightness residuals of both kinds, computed at the same points."""
        alive = self._alive & self._inside(frame)
        index = np.flatnonzero(alive.any(axis=0))
        places = np.where(alive[1, index, None], self._places[1, index], self._places[0, index])
        for kind, residual in enumerate(self._residuals):
            residual.add(self._changes(kind, frame, radiance, index, places))

    def _changes(
        self, kind: int, frame: Frame, radiance: Float32Array, index: IntArray, places: FloatArray
    ) -> FloatArray:
        """Return the brightness residuals of tracks at given points in one kind of frames; NaN if saturated."""
        first, now = self._first[1, index], windows(radiance, places)
        exposed = np.isfinite(first).all(axis=1) & np.isfinite(now).all(axis=1)
        if KINDS[kind] == "raw":
            first, now = self._first[0, index[exposed]], windows(frame.image_8_bit, places[exposed])
        else:
            first, now = (self._corrected.greys(values[exposed], frame.exposure_ms) for values in (first, now))
        changes = np.full(index.size, np.nan)
        changes[exposed] = in_contrasts(np.abs(now.mean(axis=1) - first.mean(axis=1)), first, now)
        return changes
