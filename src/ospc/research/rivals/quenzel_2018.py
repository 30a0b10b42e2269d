"""Quenzel, Horn, Houben and Behnke, "Keyframe-based photometric online calibration and color correction", 2018.

Estimates response, vignette and exposures jointly from keyframes of a moving camera, with few parameters: an even
polynomial of degree six with thin plate splines in the image plane, and a gamma curve with thin plate splines in grey
levels.

    V(x) = 1 + v₁R² + v₂R⁴ + v₃R⁶ + Σ wⱼ φ(|x − xⱼ|),    φ(r) = r² ln r
    g(M) = M^γ + Σ uⱼ φ₁(|M − Mⱼ|),                       φ₁(r) = r³, the thin plate spline of one dimension
    0 = ln g(Mᵢₚ) − ln V(xᵢₚ) − ln eᵢ − ln Lₚ             for keyframes i and scene points p, robustly

The splines of g vanish at M = 0, ½ and 1, so that γ alone fixes the exponent, either from one point of the true
response or as that of a typical camera. Not verified: the publication's number and positions of splines, and its
residual, which is logarithmic here. The publication uses poses from visual odometry only to find points again; here,
feature tracks do that.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from ospc.arrays import FloatArray, ImageSize, IntArray, size_of
from ospc.errors import NotObservableError
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome, with_and_without
from ospc.unknown_exposures.tracking import GainRobustTracker

KEY_FRAMES_APART, MOST_KEY_FRAMES = 10, 24
"""Frames from one keyframe to the next, and number of latest keyframes that an estimate uses."""

_PLATES = np.array(list(product((-0.66, 0.0, 0.66), (-0.5, 0.0, 0.5))))
"""Centres of the splines of V, in half diagonals."""

_KNOTS = np.array([0.1, 0.25, 0.4, 0.6, 0.75, 0.9])
"""Grey levels of the splines of g."""

_USUAL_GAMMA, _BENDING = 2.2, 1.5
"""γ of a typical camera, used without a known point, and weight of the pull of splines to zero, in observations."""

_ROBUST, _FEWEST = 0.05, 300
"""Scale of the robust loss of ln g, and observations needed."""

_DARKEST, _BRIGHTEST = 0.03, 0.97
_LEAST = 1e-4
"""Range of grey levels used, and least value of g and V."""


@dataclass(frozen=True)
class KeyFramePoints:
    """Grey levels in [0, 1] of scene points (by number) in keyframes (by index), all of shape (n,).

    Positions are relative to the image centre, in half diagonals, shape (n, 2); ``size`` is that of the frames.
    """

    size: ImageSize
    point: IntArray
    frame: IntArray
    grey: FloatArray
    position: FloatArray


def estimate_splines(points: KeyFramePoints, gamma: float = _USUAL_GAMMA, bending: float = _BENDING) -> Estimate:
    """Return the estimate for a given γ, which fixes the exponent, and a bending weight."""
    used = (points.grey > _DARKEST) & (points.grey < _BRIGHTEST)
    used &= np.bincount(points.point[used], minlength=points.point.max(initial=0) + 1)[points.point] > 1
    if np.count_nonzero(used) < _FEWEST:
        raise NotObservableError("too few points are seen in several keyframes")
    _, point = np.unique(points.point[used], return_inverse=True)
    numbers, frame = np.unique(points.frame[used], return_inverse=True)
    grey_basis, grey = _grey_splines(points.grey[used]), points.grey[used] ** gamma
    plane_basis = _plane_splines(points.position[used])
    # The noise of ln g is largest at small M, where ln g is steep; without weights it would flatten the curve.
    weight = points.grey[used]
    totals, frames = np.bincount(point, weights=weight**2), int(frame.max()) + 1
    knots, terms = grey_basis.shape[1], plane_basis.shape[1]

    # Only the splines, without the even polynomial (the first three terms) and the exposures.
    bent = np.r_[:knots, knots + 3 : knots + terms]

    def residuals(unknown: FloatArray) -> FloatArray:
        curve = np.log(np.maximum(grey + grey_basis @ unknown[:knots], _LEAST))
        shade = np.log(np.maximum(1 + plane_basis @ unknown[knots : knots + terms], _LEAST))
        rest = curve - shade - np.append(0.0, unknown[knots + terms :])[frame]
        # ln L is the mean over the observations of a point.
        data = weight * (rest - (np.bincount(point, weights=weight**2 * rest) / totals)[point])
        return np.append(data, bending * unknown[bent])

    start = np.zeros(knots + terms + frames - 1)
    found = least_squares(residuals, start, loss="soft_l1", f_scale=_ROBUST, method="trf", x_scale="jac").x
    exposures = np.exp(np.append(0.0, found[knots + terms :]))
    return Estimate(
        _response(gamma, found[:knots]),
        _vignette(points.size, found[knots : knots + terms]),
        exposures=dict(zip(numbers.tolist(), exposures.tolist(), strict=True)),
    )


def _grey_splines(grey: FloatArray) -> FloatArray:
    """Return the splines of g, each less the parabola through its values at 0, ½ and 1, shape (n, knots)."""
    at = np.abs(grey[:, None] - _KNOTS) ** 3
    ends = [np.abs(m - _KNOTS) ** 3 for m in (0.0, 0.5, 1.0)]
    x = grey[:, None]
    parabola = ends[0] * 2 * (x - 0.5) * (x - 1) - ends[1] * 4 * x * (x - 1) + ends[2] * 2 * x * (x - 0.5)
    return np.asarray(at - parabola)


def _plane_splines(position: FloatArray) -> FloatArray:
    """Return R², R⁴, R⁶ and the splines of V, each 0 at the centre, shape (n, 3 + plates)."""

    def plates(places: FloatArray) -> FloatArray:
        squared = np.maximum(np.sum((places[:, None] - _PLATES) ** 2, axis=-1), 1e-12)
        return np.asarray(squared * np.log(squared) / 2)

    squared = np.sum(position**2, axis=-1, keepdims=True)
    return np.hstack([squared ** np.array([1, 2, 3]), plates(position) - plates(np.zeros((1, 2)))])


def _response(gamma: float, weights: FloatArray) -> Response:
    levels = np.linspace(0, 1, 256)
    curve = levels**gamma + _grey_splines(levels) @ weights
    rising = np.maximum.accumulate(np.maximum(curve, 0)) + 1e-6 * np.arange(256)
    return Response.from_values(rising, model={"name": "quenzel", "gamma": gamma})


def _vignette(size: ImageSize, weights: FloatArray) -> RasterVignette:
    position = normalised(pixel_grid(size), size).reshape(-1, 2)
    image = 1 + _plane_splines(position) @ weights
    return RasterVignette(np.maximum(image, _LEAST).reshape(size[1], size[0]).astype(np.float32), {"name": "quenzel"})


class Quenzel:
    """The method, on positions and grey levels of tracked features in keyframes.

    It has two variants: with and without one point of the true response, which fixes γ.
    """

    def __init__(self, truth: Response | None) -> None:
        self._truth = truth
        self._tracker = GainRobustTracker()
        self._count = 0
        self._size: ImageSize = (2, 2)
        self._key_frames: deque[tuple[int, IntArray, FloatArray, FloatArray]] = deque(maxlen=MOST_KEY_FRAMES)

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._tracker.push(frame)
        self._size = size_of(frame.image)
        if self._count % KEY_FRAMES_APART == 0:
            tracks, places = self._tracker.current
            self._key_frames.append((frame.index, tracks, self._tracker.grey_at_current(frame), places))
        self._count += 1

    def found(self) -> dict[str, Outcome]:
        """Return the possible variants."""
        points = self._points()

        def estimate(known: Response | None) -> Estimate:
            gamma = _USUAL_GAMMA if known is None else float(np.log(known.inverse(0.5)) / np.log(0.5))
            return estimate_splines(points, gamma)

        return with_and_without("quenzel", self._truth, estimate)

    def _points(self) -> KeyFramePoints:
        """Return the observations of the latest keyframes."""
        if not self._key_frames:
            raise NotObservableError("too few points are seen in several keyframes")
        indices, tracks, greys, places = zip(*self._key_frames, strict=True)
        frame = np.repeat(indices, [len(track) for track in tracks])
        position = normalised(np.concatenate(places).reshape(-1, 2).astype(np.float64), self._size)
        return KeyFramePoints(self._size, np.concatenate(tracks), frame, np.concatenate(greys), position)
