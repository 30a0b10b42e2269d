"""A real hand-held video with a true exposure for each frame: some frames are for fitting, the others for evaluation.

Evaluation reads the frames differently from every method: SIFT on histogram-equalised frames, a homography to reject
wrong matches, and then flat regions near the features instead of the features themselves. A flat region moves like
its nearest feature, and an error of a pixel hardly changes its grey level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice

import cv2
import numpy as np
from scipy.spatial import KDTree

from ospc.arrays import Float32Array, FloatArray
from ospc.correspondence.features import Features, SiftExtractor, extract, match
from ospc.formats.dso import read_pcalib
from ospc.recording import Frame, open_recording
from ospc.research.scoring import HeldOutPair, Truth
from ospc.research.source import PCALIB, GivenSource
from ospc.unknown_exposures.tracking import sampled

VIDEO = "borealhdr_left"
"""Name of the recording in the folder of real data."""
_FITTED_FRAMES = 40
"""Frames that the methods get; the rest is for evaluation."""
_FARTHEST, _FEWEST_PLACES = 3, 50
"""Largest distance of the frames of a pair, and the flat points that it needs."""
_LABORATORY_GREYS, _MAX_RADIAL_DISPLACEMENT = (5, 215), 0.01
"""Range in which the authors' response is valid, and largest |R₀ − R₁| of a pair: the true vignette is unknown."""
_FEATURES, _RATIO, _FEWEST_MATCHES = 3000, 0.8, 20
"""SIFT features per frame, largest ratio of best to second-best match distance (Lowe 2004), and matches needed."""
_OUTLIER_PX = 4.0
"""Distance from the homography beyond which a match is wrong; generous, because a scene with depth is not a plane."""
_NEAREST_PX, _SPACING_PX = 24.0, 4
"""Largest distance of a point from the feature whose displacement it shares, and spacing of the points."""
_SMOOTHING_PX, _FLAT = 2.0, 0.004
"""Standard deviation of the smoothing, and largest gradient of a flat point in full scale per pixel."""


@dataclass(frozen=True)
class VideoSource(GivenSource):
    """The video with its authors' ``pcalib.txt``. Methods get the first frames; the others form held-out pairs."""

    most_frames: int | None = _FITTED_FRAMES
    group: str = field(default="video", kw_only=True)

    def truth(self) -> Truth:
        """Return the authors' laboratory calibration."""
        return Truth(read_pcalib(self.path / PCALIB), greys=_LABORATORY_GREYS)

    def held_out(self) -> Sequence[HeldOutPair]:
        """Return pairs of the evaluation frames."""
        return held_out_pairs(list(islice(open_recording(self.path), _FITTED_FRAMES, None)))


def held_out_pairs(frames: list[Frame]) -> list[HeldOutPair]:
    """Return the flat points of any two frames with different exposure that are at most three frames apart."""
    read = [SampledFrame.of(frame) for frame in frames]
    greys = (_LABORATORY_GREYS[0] / 255, _LABORATORY_GREYS[1] / 255)
    pairs = (
        flat_pair(first, second, greys, _MAX_RADIAL_DISPLACEMENT)
        for place, first in enumerate(read)
        for second in read[place + 1 : place + 1 + _FARTHEST]
        if first.exposure_ms != second.exposure_ms
    )
    return [pair for pair in pairs if pair is not None and len(pair.grey0) >= _FEWEST_PLACES]


@dataclass(frozen=True)
class SampledFrame:
    """A frame with its exposure, SIFT features, smoothed grey levels and gradients.

    The smoothed grey levels, in [0, 1], and their gradient per pixel have shape (height, width).
    """

    exposure_ms: float
    features: Features
    grey: Float32Array
    gradient: Float32Array

    @classmethod
    def of(cls, frame: Frame) -> SampledFrame:
        """Compute features and gradients of a frame."""
        grey = frame.image.astype(np.float32) / np.float32(frame.max_grey)
        equalised = cv2.equalizeHist(np.rint(grey * 255).astype(np.uint8))
        features = extract(Frame.of_array(equalised, frame.exposure_ms), SiftExtractor(_FEATURES))
        smooth = cv2.GaussianBlur(grey, (0, 0), _SMOOTHING_PX)
        gradient = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)) / 8
        return cls(frame.exposure_ms, features, smooth.astype(np.float32), gradient.astype(np.float32))


def flat_pair(
    first: SampledFrame, second: SampledFrame, greys: tuple[float, float], max_radial_displacement: float
) -> HeldOutPair | None:
    """Return the grey levels of flat points in both frames; None if the frames do not match.

    The grey levels lie between ``greys``, in [0, 1]; after smoothing, noise is too small for a selection bias. R
    differs by at most ``max_radial_displacement``, so that the vignette cancels.
    """
    points0, points1 = _matches(first.features, second.features)
    if len(points0) < _FEWEST_MATCHES:
        return None
    height, width = first.grey.shape
    x, y = np.meshgrid(np.arange(0, width, _SPACING_PX), np.arange(0, height, _SPACING_PX))
    places0 = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    distance, nearest = KDTree(points0).query(places0)
    places1 = places0 + (points1 - points0)[nearest]
    margin = 4 * _SMOOTHING_PX
    far = np.array([width, height]) - 1 - margin
    within = np.all([(p >= margin) & (p <= far) for p in (places0, places1)], axis=(0, 2))
    near = (distance < _NEAREST_PX) & within
    places0, places1 = places0[near], places1[near]
    grey0, grey1 = sampled(first.grey, places0), sampled(second.grey, places1)
    flat = (sampled(first.gradient, places0) < _FLAT) & (sampled(second.gradient, places1) < _FLAT)
    exposed = (np.minimum(grey0, grey1) > greys[0]) & (np.maximum(grey0, grey1) < greys[1])
    size, ratio = (width, height), first.exposure_ms / second.exposure_ms
    pair = HeldOutPair((0, 1), size, places0, places1, grey0, grey1, ratio)
    return pair.select(flat & exposed & (pair.radial_displacement < max_radial_displacement))


def _matches(first: Features, second: Features) -> tuple[FloatArray, FloatArray]:
    index0, index1 = match(first, second, SiftExtractor.norm, _RATIO)
    points0, points1 = first.points[index0], second.points[index1]
    if len(points0) < _FEWEST_MATCHES:
        return points0, points1
    # A scene with depth is not a plane; the tolerance accepts points near the dominant one.
    cv2.setRNGSeed(0)
    _, mask = cv2.findHomography(points0, points1, cv2.RANSAC, _OUTLIER_PX)
    agree = np.zeros(len(points0), bool) if mask is None else mask.ravel() > 0
    return points0[agree], points1[agree]
