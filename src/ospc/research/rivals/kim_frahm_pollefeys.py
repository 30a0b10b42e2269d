"""Kim, Frahm and Pollefeys, "Joint feature tracking and radiometric calibration from auto-exposure video", 2007.

Lucas–Kanade tracking of ln irradiance. For every pixel x in the window of a feature, with the empirical model of ln
g, here called g = g₀ + Σ cₖhₖ, and one exposure difference K between the images I and J,

    g(J(x + d)) − g(I(x)) − K = 0

After linearisation, the unknowns are the displacement d of each feature, c and K. The normal equations are sparse:
the Schur complement eliminates the 2×2 blocks of displacements and leaves a small system for c and K. Displacements
are found from coarse to fine. All pairs share the response, so their reduced systems, with K eliminated likewise, add
up.

Response and exposures are known up to an exponent, which the publication fixes by the true g at one grey level;
without it, g keeps the value of g₀ there. There is no vignette. The journal version appeared in 2010. Not verified:
the publications' window and number of features.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome, with_and_without
from ospc.research.rivals.log_response import LogModel, log_model
from ospc.unknown_exposures.tracking import sampled

_GREYS = np.arange(256)
_SIDE, _PYRAMID, _STEPS = 9, 4, 6
"""Side of a window in pixels, pyramid levels, and most steps per level."""

_FEATURES, _QUALITY, _SPACING_PX = 200, 0.01, 10
"""Features of a pair, least strength of a corner relative to the strongest, and least distance of corners."""

_DARKEST, _BRIGHTEST = 5.0, 250.0
"""Range of grey levels used."""

_SETTLED_PX = 0.02
_OUTLIER, _FEWEST = 0.1, 15
"""RMS residual of ln g above which a feature is lost, and features that a pair needs."""

_EVERY, _TURNS = 10, 4
"""Pairs after which c is estimated again during tracking, and rounds over all stored pairs at the end."""

_LEAST_CHANGE, _MOST_PAIRS = 0.05, 60
"""Smallest |K| of a pair, because with less the noise of grey levels dominates, and most pairs stored."""


@dataclass(frozen=True)
class TrackedPair:
    """Grey levels in [0, 255] of tracked windows in both images, shape (features, pixels).

    The gradient is that of the second image along x and y, shape (features, pixels, 2); displacements have the shape
    (features, 2), and ``log_ratio`` is K.
    """

    first: FloatArray
    second: FloatArray
    gradient: FloatArray
    displacement: FloatArray
    log_ratio: float


def track(image0: Image, image1: Image, points: FloatArray, curve: FloatArray) -> TrackedPair | None:
    """Track features between two images of different brightness, given ln g at 256 grey levels.

    Returns None if too few features remain. All features share K, as in the publication; c is fixed while a pair is
    tracked.
    """
    pyramid = [(image0.astype(np.float32), image1.astype(np.float32))]
    for _ in range(_PYRAMID - 1):
        pyramid.append((cv2.pyrDown(pyramid[-1][0]), cv2.pyrDown(pyramid[-1][1])))
    displacement = np.zeros_like(points)
    before, after = (float(np.median(np.interp(image, _GREYS, curve))) for image in (image0, image1))
    ratio = after - before
    for level in reversed(range(_PYRAMID)):
        first, second = pyramid[level]
        scaled = (points + 0.5) / 2**level - 0.5
        displacement *= 2
        for _ in range(_STEPS):
            pair = _windows(first, second, scaled, displacement, ratio)
            step, ratio = _solve_displacements(pair, curve)
            displacement = displacement + step
            if np.median(np.abs(step)) < _SETTLED_PX:
                break
    pair = _windows(*pyramid[0], points, displacement, ratio)
    residual = _residual(pair, curve)
    weight = _exposed(pair)
    error = np.sqrt((weight * residual**2).sum(axis=1) / np.maximum(weight.sum(axis=1), 1))
    good = (error < _OUTLIER) & _inside(points + displacement, image0) & (weight.mean(axis=1) > 0.5)
    if np.count_nonzero(good) < _FEWEST:
        return None
    return TrackedPair(pair.first[good], pair.second[good], pair.gradient[good], displacement[good], ratio)


def _inside(points: FloatArray, image: Image) -> BoolArray:
    return np.asarray(np.all((points > _SIDE) & (points < np.array(image.shape[::-1]) - _SIDE), axis=1))


def _windows(
    first: Float32Array, second: Float32Array, points: FloatArray, displacement: FloatArray, ratio: float
) -> TrackedPair:
    offsets = np.stack(np.meshgrid(*[np.arange(_SIDE) - _SIDE // 2] * 2), axis=-1).reshape(-1, 2)
    here = (points[:, None] + offsets).reshape(-1, 2)
    there = ((points + displacement)[:, None] + offsets).reshape(-1, 2)
    shape = (len(points), len(offsets))
    across, down = np.array([0.5, 0]), np.array([0, 0.5])
    gradient = np.stack(
        [sampled(second, there + axis) - sampled(second, there - axis) for axis in (across, down)], axis=-1
    )
    grey0, grey1 = sampled(first, here).reshape(shape), sampled(second, there).reshape(shape)
    return TrackedPair(grey0, grey1, gradient.reshape(*shape, 2), displacement, ratio)


def _exposed(pair: TrackedPair) -> FloatArray:
    darkest, brightest = np.minimum(pair.first, pair.second), np.maximum(pair.first, pair.second)
    return np.asarray((darkest > _DARKEST) & (brightest < _BRIGHTEST), dtype=float)


def _residual(pair: TrackedPair, curve: FloatArray) -> FloatArray:
    return np.asarray(np.interp(pair.second, _GREYS, curve) - np.interp(pair.first, _GREYS, curve) - pair.log_ratio)


def _slopes(pair: TrackedPair, curve: FloatArray) -> FloatArray:
    """Return the derivatives of g(J(x + d)) with respect to d, shape (features, pixels, 2)."""
    return np.asarray(np.interp(pair.second, _GREYS, np.gradient(curve))[..., None] * pair.gradient)


def _solve_displacements(pair: TrackedPair, curve: FloatArray) -> tuple[FloatArray, float]:
    """Return the step of every displacement, and K, with c fixed."""
    weight, slope = _exposed(pair), _slopes(pair, curve)
    residual = _residual(pair, curve)
    eliminated = _Eliminated.of(weight, slope)
    ones = np.ones((*residual.shape, 1))
    matrix, vector = eliminated.reduced(ones, residual)
    change = float(vector[0] / max(matrix[0, 0], 1e-12))
    step = eliminated.displacements(residual - change)
    # A step beyond the window is outside the linear range.
    return np.clip(-step, -_SIDE / 2, _SIDE / 2), pair.log_ratio + change


@dataclass(frozen=True)
class _Eliminated:
    """Eliminates displacements from the normal equations by their 2×2 blocks."""

    weight: FloatArray
    slope: FloatArray
    inverse: FloatArray

    @classmethod
    def of(cls, weight: FloatArray, slope: FloatArray) -> _Eliminated:
        blocks = np.einsum("fp,fpi,fpj->fij", weight, slope, slope)
        ridge = 1e-6 + 1e-4 * np.trace(blocks, axis1=1, axis2=2)
        return cls(weight, slope, np.linalg.inv(blocks + ridge[:, None, None] * np.eye(2)))

    def displacements(self, target: FloatArray) -> FloatArray:
        """Return the d that best explains a target, shape (features, pixels)."""
        moment = np.einsum("fp,fpi,fp->fi", self.weight, self.slope, target)
        return np.asarray(np.einsum("fij,fj->fi", self.inverse, moment))

    def reduced(self, columns: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return matrix and vector of the Schur complement for columns, shape (features, pixels, unknowns)."""
        mixed = np.einsum("fp,fpi,fpk->fik", self.weight, self.slope, columns)
        moment = np.einsum("fp,fpi,fp->fi", self.weight, self.slope, target)
        matrix = np.einsum("fp,fpk,fpl->kl", self.weight, columns, columns)
        matrix -= np.einsum("fik,fij,fjl->kl", mixed, self.inverse, mixed)
        vector = np.einsum("fp,fpk,fp->k", self.weight, columns, target)
        vector -= np.einsum("fik,fij,fj->k", mixed, self.inverse, moment)
        return matrix, vector


def reduced_system(pair: TrackedPair, model: LogModel, coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return A and b of A c = b for a pair, with displacements and K eliminated; g₀ gives the right-hand side."""
    columns = [np.interp(pair.second, _GREYS, h) - np.interp(pair.first, _GREYS, h) for h in model.components]
    columns.append(-np.ones_like(pair.first))
    target = np.interp(pair.first, _GREYS, model.mean) - np.interp(pair.second, _GREYS, model.mean)
    weight = _exposed(pair) * model.weight(pair.first, pair.second)
    eliminated = _Eliminated.of(weight, _slopes(pair, model.curve(coefficients)))
    matrix, vector = eliminated.reduced(np.stack(columns, axis=-1), target)
    last = max(matrix[-1, -1], 1e-12)
    inner = matrix[:-1, :-1] - np.outer(matrix[:-1, -1], matrix[-1, :-1]) / last
    return inner, vector[:-1] - matrix[:-1, -1] * vector[-1] / last


class KimFrahmPollefeys:
    """The method, with one point of the true response (if known) and without."""

    def __init__(self, truth: Response | None) -> None:
        self._truth, self._model = truth, log_model()
        self._coefficients = np.zeros(len(self._model.components))
        self._previous: Image | None = None
        self._pairs: list[TrackedPair] = []
        self._tracked = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        image = frame.image_8_bit
        previous, self._previous = self._previous, image
        if previous is None:
            return
        corners = cv2.goodFeaturesToTrack(previous, _FEATURES, _QUALITY, _SPACING_PX)
        if corners is None:
            return
        points = corners.reshape(-1, 2).astype(np.float64)
        points = points[_inside(points, previous)]
        pair = track(previous, image, points, self._model.curve(self._coefficients)) if len(points) else None
        if pair is None or abs(pair.log_ratio) < _LEAST_CHANGE:
            return
        # Pairs with the largest change in brightness show the response best.
        self._pairs = sorted([*self._pairs, pair], key=lambda one: -abs(one.log_ratio))[:_MOST_PAIRS]
        self._tracked += 1
        if self._tracked % _EVERY == 0:
            self._coefficients = self._solved(None)

    def found(self) -> dict[str, Outcome]:
        """Return the possible variants."""
        name = "kim-frahm-pollefeys"
        return with_and_without(
            name, self._truth, lambda known: Estimate(self._model.response(self._solved(known), name))
        )

    def _solved(self, truth: Response | None) -> FloatArray:
        """Return c from all stored pairs."""
        if not self._pairs:
            raise NotObservableError(
                "the exposure hardly changes between frames, or too few features could be tracked where it does"
            )
        coefficients = self._coefficients
        for _ in range(_TURNS):
            systems = [reduced_system(pair, self._model, coefficients) for pair in self._pairs]
            matrix, vector = (np.sum(parts, axis=0) for parts in zip(*systems, strict=True))
            coefficients = self._model.solved(matrix, vector, truth)
        return coefficients
