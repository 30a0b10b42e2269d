"""The relative irradiance scale of several cameras that see the same scene at the same time.

Response and vignette of a camera are known up to its own scale: g(1) = 1, V = 1 at the centre. If the views of two
calibrated cameras overlap, their common scene points determine the ratio of the two scales: g(M) / (e V) = s L for
every point of radiance L, where s is the scale of the camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse.csgraph import connected_components

from ospc.arrays import BoolArray, Float32Array, FloatArray, IntArray, nearest
from ospc.correspondence.features import Features, SiftExtractor, match
from ospc.errors import NotObservableError
from ospc.exposures.used import with_used_exposures
from ospc.formats.files import json_text, write_text
from ospc.numerics.robust import robust_scale
from ospc.photometry.calibration import Calibration
from ospc.recording import Frame, Recording
from ospc.recording.stream import usable_frames
from ospc.settings.pooling import (
    BRIGHTEST_RIG_GREY,
    DARKEST_RIG_GREY,
    EPIPOLAR_CONFIDENCE,
    ERROR_OF_MEDIAN,
    LONGEST_SIDE_PX,
    MATCH_RATIO,
    MAX_CLIPPED_SHARE,
    MAX_EPIPOLAR_PX,
    MAX_GAP_S,
    MAX_MOMENTS,
    MAX_RIG_FEATURES,
    MIN_MATCHES,
    MIN_MOMENTS_FOR_SPREAD,
    RIG_SMOOTHING_PX,
    STRETCHED_QUANTILES,
    SYSTEMATIC_SIGMA,
)

SCHEMA = "ospc-rig/1"


@dataclass(frozen=True)
class PairScale:
    """Scale ratio from the overlap of two cameras: ln (s₀/s₁), its standard deviation, and the amount of data."""

    cameras: tuple[str, str]
    log_ratio: float
    sigma: float
    moments: int
    points: int


@dataclass(frozen=True)
class RigScale:
    """Relative irradiance scale of the cameras of a rig.

    Attributes
    ----------
    reference
        The camera whose scale is 1.
    scale, sigma
        s of every camera that overlaps with the reference, directly or through others, and its standard deviation.
        The irradiance g(M) / (e V) of a camera divided by its s is comparable across the rig.
    pairs, left_out
        The pairs of cameras compared, and the cameras of unknown scale with the reason.
    misfit
        Largest inconsistency between overlaps, in standard deviations; 0 if no scale is measured twice.
    """

    reference: str
    scale: dict[str, float]
    sigma: dict[str, float]
    pairs: tuple[PairScale, ...]
    left_out: dict[str, str] = field(default_factory=dict)
    misfit: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return all fields as JSON-compatible values, the documented content of ``rig.json``."""
        pairs = [vars(pair) | {"cameras": list(pair.cameras)} for pair in self.pairs]
        return {"schema": SCHEMA, **vars(self), "pairs": pairs}

    def save(self, path: str | Path) -> Path:
        """Write a JSON file atomically and return its path; FormatError if that fails."""
        return write_text(path, json_text(self.as_dict()) + "\n")


def rig_scale(recordings: Mapping[str, Recording], calibrations: Mapping[str, Calibration]) -> RigScale:
    """Return the relative irradiance scale of cameras that recorded at the same time.

    Recordings and calibrations are given by camera name. The first usable camera is the reference.

    Raises
    ------
    NotObservableError
        If fewer than two cameras have both response and vignette, from known exposures.
    """
    left_out = {name: why for name in recordings if (why := _unsuitable(calibrations.get(name)))}
    names = [name for name in recordings if name not in left_out]
    if len(names) < 2:
        raise NotObservableError(
            "a relative scale needs at least two cameras with known response, vignette and exposures, but there is "
            f"{'only one' if names else 'none'}"
        )
    moments = _moments([recordings[name] for name in names])
    seen = {
        name: _all_seen(with_used_exposures(recordings[name], calibrations[name]), calibrations[name], frames)
        for name, frames in zip(names, moments.T, strict=True)
    }
    pairs = [
        found
        for first, second in combinations(names, 2)
        if (found := _compared((first, second), seen[first], seen[second])) is not None
    ]
    scale = _solved(names, tuple(pairs), left_out)
    apart = (
        f"none of its frames was recorded within {1000 * MAX_GAP_S:g} ms of one of {names[0]}; the time stamps of "
        "all cameras must come from one clock"
    )
    never = {name: apart for name, frames in zip(names, moments.T, strict=True) if np.all(frames < 0)}
    return replace(scale, left_out=scale.left_out | never)


def _unsuitable(calibration: Calibration | None) -> str:
    """Return why a camera cannot be compared with others, or an empty string."""
    parts = ("response", "vignette")
    unknown = [part for part in parts if calibration is None or getattr(calibration, part) is None]
    if unknown:
        return f"its {' and '.join(unknown)} could not be determined"
    # Estimated exposures have a scale and an exponent of their own.
    return "its exposures are unknown" if calibration is not None and calibration.caveat else ""


def _moments(recordings: Sequence[Recording]) -> IntArray:
    """Return simultaneous frames of all cameras, evenly spread, shape (moments, cameras); −1 where one is missing."""
    stamps = [np.asarray(recording.stamps_s, dtype=np.float64) for recording in recordings]
    chosen = np.unique(np.linspace(0, len(stamps[0]) - 1, min(MAX_MOMENTS, len(stamps[0]))).astype(np.int64))
    columns = [chosen]
    for own in stamps[1:]:
        found = nearest(own, stamps[0][chosen])
        columns.append(np.where(np.abs(own[found] - stamps[0][chosen]) <= MAX_GAP_S, found, -1))
    return np.stack(columns, axis=1)


def _all_seen(recording: Recording, calibration: Calibration, frames: IntArray) -> list[Features | None]:
    """Return the features of a camera at each moment; None without a usable frame."""
    found: list[Features | None] = [None] * len(frames)
    extractor = SiftExtractor(MAX_RIG_FEATURES)
    for frame in usable_frames(frame for frame in recording if frame.index in frames):
        for moment in np.flatnonzero(frames == frame.index):
            found[moment] = _seen(frame, calibration, extractor)
    return found


def _seen(frame: Frame, calibration: Calibration, extractor: SiftExtractor) -> Features:
    """Return the features of a frame, with the irradiance corrected for the vignette as their grey."""
    response, vignette = calibration.response, calibration.vignette
    assert response is not None
    assert vignette is not None
    image = frame.image.astype(np.float32) / np.float32(frame.max_grey)
    reduction = -(-max(image.shape) // LONGEST_SIDE_PX)
    irradiance = np.asarray(response.inverse(image) / (frame.exposure_ms * vignette.image()), dtype=np.float32)
    bad = ((image < DARKEST_RIG_GREY) | (image > BRIGHTEST_RIG_GREY)).astype(np.float32)
    if frame.mask is not None:
        bad = np.maximum(bad, (~frame.mask).astype(np.float32))
    size = (image.shape[1] // reduction, image.shape[0] // reduction)
    small, bad = (np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA)) for values in (irradiance, bad))
    points, descriptors = extractor.detect(_alike(small))
    column, row = np.clip(np.rint(points).astype(np.int64), 0, np.array(small.shape[::-1]) - 1).T
    smooth = cv2.GaussianBlur(small, (0, 0), RIG_SMOOTHING_PX)
    exposed = cv2.GaussianBlur(bad, (0, 0), RIG_SMOOTHING_PX)[row, column] < MAX_CLIPPED_SHARE
    value = smooth[row, column]
    kept = exposed & (value > 0)
    return Features(frame.index, points[kept], value[kept].astype(np.float64), descriptors[kept])


def _alike(irradiance: Float32Array) -> npt.NDArray[np.uint8]:
    """Return an image that does not depend on camera and exposure: ln irradiance, stretched."""
    log_value = np.log(np.maximum(irradiance, np.float32(1e-9)))
    low, high = np.quantile(log_value, STRETCHED_QUANTILES)
    return np.asarray(np.clip((log_value - low) / max(high - low, 1e-6) * 255, 0, 255), dtype=np.uint8)


def _compared(
    cameras: tuple[str, str], seen0: Sequence[Features | None], seen1: Sequence[Features | None]
) -> PairScale | None:
    """Return the scale ratio of two cameras; None if they share too few points."""
    medians, spreads, points = [], [], 0
    for one, other in zip(seen0, seen1, strict=True):
        if one is None or other is None:
            continue
        first, second = match(one, other, SiftExtractor.norm, MATCH_RATIO)
        kept = _epipolar(one.points[first], other.points[second])
        if np.count_nonzero(kept) < MIN_MATCHES:
            continue
        difference = np.log(one.grey)[first[kept]] - np.log(other.grey)[second[kept]]
        middle = float(np.median(difference))
        medians.append(middle)
        spreads.append(robust_scale(difference - middle) / np.sqrt(len(difference)))
        points += len(difference)
    if not medians:
        return None
    # The spread between moments includes errors shared by all matches of a moment.
    middle = float(np.median(medians))
    between = robust_scale(np.array(medians) - middle) if len(medians) >= MIN_MOMENTS_FOR_SPREAD else 0.0
    sigma = max(float(np.median(spreads)), between) * ERROR_OF_MEDIAN / np.sqrt(len(medians))
    return PairScale(cameras, middle, float(np.hypot(sigma, SYSTEMATIC_SIGMA)), len(medians), points)


def _epipolar(points0: FloatArray, points1: FloatArray) -> BoolArray:
    """Return which matches lie on each other's epipolar lines."""
    if len(points0) < MIN_MATCHES:
        return np.zeros(len(points0), np.bool_)
    cv2.setRNGSeed(0)
    _, inlier = cv2.findFundamentalMat(points0, points1, cv2.FM_RANSAC, MAX_EPIPOLAR_PX, EPIPOLAR_CONFIDENCE)
    if inlier is None or len(inlier) != len(points0):
        return np.zeros(len(points0), np.bool_)
    return np.asarray(inlier.ravel() > 0)


def _solved(names: Sequence[str], pairs: tuple[PairScale, ...], left_out: dict[str, str]) -> RigScale:
    """Return the scales that fit all overlaps best in least squares; that of the first camera is 1."""
    overlap = np.eye(len(names))
    for pair in pairs:
        overlap[names.index(pair.cameras[0]), names.index(pair.cameras[1])] = 1
    part = connected_components(overlap, directed=False)[1]
    reached = {name for name, number in zip(names, part, strict=True) if number == part[0]}
    left_out = left_out | {
        name: f"its view overlaps with no camera that connects it to {names[0]}"
        for name in names
        if name not in reached
    }
    inside = [name for name in names if name in reached]
    used = [pair for pair in pairs if pair.cameras[0] in reached]
    rows = np.zeros((len(used), len(inside)))
    for row, pair in zip(rows, used, strict=True):
        row[[inside.index(name) for name in pair.cameras]] = 1, -1
    weight = np.array([1 / pair.sigma for pair in used])
    target = np.array([pair.log_ratio for pair in used])
    weighted = rows[:, 1:] * weight[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted)
    log_scale, sigma = np.zeros(len(inside)), np.zeros(len(inside))
    log_scale[1:] = covariance @ weighted.T @ (target * weight)
    sigma[1:] = np.sqrt(np.diag(covariance))
    misfit = float(np.max(np.abs(rows @ log_scale - target) * weight, initial=0.0))
    scale = np.exp(log_scale)
    return RigScale(
        names[0],
        dict(zip(inside, scale.tolist(), strict=True)),
        dict(zip(inside, (scale * sigma).tolist(), strict=True)),
        pairs,
        left_out,
        misfit if len(used) >= len(inside) else 0.0,
    )
