"""Methods of OpenCV for a static camera: the response from images of one view at several exposures.

They need all images at once and estimate no vignette. Images are 8 bit, shape (n, height, width), and their exposures
have shape (n,).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import isotonic_regression

from ospc.arrays import FloatArray
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome

_LEAST_CHANGE, _LEAST_SLOPE = 1.05, 1e-9
"""Least ratio of the largest to the smallest exposure, and step of g per level where it would be flat."""
_DARKEST, _BRIGHTEST = 3, 250
"""Range of grey levels in which g is used; saturation and noise distort it elsewhere."""
_FEWEST_LEVELS, _END_LEVELS = 20, 10
"""Grey levels that must have a value, and number of those from which g is extrapolated."""
_MOST_IMAGES, _FEWEST_UNSATURATED = 24, 100
"""Images of a series, enough for every method and few enough for memory, and never-saturated pixels that suffice."""
_SMOOTHNESS, _TURNS = 10.0, 60
"""λ of Debevec and Malik, OpenCV's default, and iterations of Robertson's method."""

_Images: TypeAlias = npt.NDArray[np.uint8]


def debevec_malik(images: _Images, exposures_ms: FloatArray, samples: int = 200) -> Response:
    """Return the response of Debevec and Malik, "Recovering high dynamic range radiance maps from photographs", 1997.

    OpenCV's implementation, on this number of pixels. ln g has 256 free values. Minimises
    Σ w(M)² (ln g(Mᵢₚ) − ln Eₚ − ln tᵢ)² + λ Σ w(M)² (second difference of ln g)², linear in all unknowns, with a
    triangular weight w.
    """
    chosen = sampled(images, samples)
    method = cv2.createCalibrateDebevec(chosen.shape[1], _SMOOTHNESS, False)
    return _by_opencv(method, chosen[:, None], exposures_ms, "debevec-malik")


def robertson(images: _Images, exposures_ms: FloatArray) -> Response:
    """Return the response of Robertson et al., "Estimation-theoretic approach to dynamic range enhancement …", 2003.

    OpenCV's implementation. g has 256 free values. Minimises Σ w(M) (g(Mᵢₚ) − tᵢEₚ)² for g and the irradiances E in
    turn, with a weight w that falls towards both ends like a normal distribution.
    """
    return _by_opencv(cv2.createCalibrateRobertson(_TURNS, 0.0), images, exposures_ms, "robertson")


AT_REST: dict[str, Callable[[_Images, FloatArray], Response]] = {
    "debevec-malik": debevec_malik,
    "robertson": robertson,
}
"""The methods by name."""


class CameraAtRest:
    """A method for a static camera by name, as studies run it."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._frames: list[Frame] = []

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._frames.append(frame)

    def found(self) -> dict[str, Outcome]:
        """Return the response."""
        series = series_of(self._frames)
        exposures_ms = np.array([frame.exposure_ms for frame in series])
        images = np.array([frame.image_8_bit for frame in series], dtype=np.uint8)
        return {self._name: Estimate(AT_REST[self._name](images, exposures_ms))}


def series_of(frames: Sequence[Frame], most: int = _MOST_IMAGES) -> list[Frame]:
    """Return at most ``most`` frames with exposures spread evenly over their range, darkest first."""
    ordered = sorted(frames, key=lambda frame: frame.exposure_ms)
    if len(ordered) <= most:
        return ordered
    logs = np.log([frame.exposure_ms for frame in ordered])
    wanted = np.linspace(logs[0], logs[-1], most)
    return [ordered[i] for i in sorted({int(np.argmin(np.abs(logs - w))) for w in wanted})]


def sampled(images: _Images, count: int) -> _Images:
    """Return up to ``count`` pixels in all images, spread evenly over brightness, shape (n, count).

    Pixels that are saturated in any image are left out if enough others remain.
    """
    flat = images.reshape(len(images), -1)
    whole = flat.max(axis=0) < 255
    flat = flat[:, whole] if np.count_nonzero(whole) >= min(count, _FEWEST_UNSATURATED) else flat
    sums = flat.sum(axis=0, dtype=np.int64)
    order = np.argsort(sums + np.random.default_rng(0).random(flat.shape[1]))
    sums = sums[order]
    places = np.searchsorted(sums, np.linspace(sums[0], sums[-1], count))
    return np.asarray(flat[:, order[np.unique(np.clip(places, 0, len(order) - 1))]])


def _by_opencv(method: Any, images: _Images, exposures_ms: FloatArray, name: str) -> Response:
    if exposures_ms.max() < _LEAST_CHANGE * exposures_ms.min():
        raise NotObservableError("the exposures of a series must change by 5 % or more to show a response")
    colour = [np.ascontiguousarray(image[:, :, None].repeat(3, axis=2)) for image in images]
    found = method.process(colour, (exposures_ms / exposures_ms.mean()).astype(np.float32))
    return response_of_values(np.asarray(found, dtype=np.float64).reshape(256, -1)[:, 0], name)


def response_of_values(values: FloatArray, name: str) -> Response:
    """Return 256 values of g, NaN where unknown, as a response.

    The ends are replaced: below by a line to the origin, above by the slope of the brightest known levels. Gaps are
    interpolated, and the curve is made non-decreasing by isotonic regression.

    Raises
    ------
    NotObservableError
        If too few values are known, or they do not increase.
    """
    levels = np.arange(256)
    known = np.flatnonzero(np.isfinite(values) & (values > 0) & (levels >= _DARKEST) & (levels <= _BRIGHTEST))
    if known.size < _FEWEST_LEVELS or values[known[-1]] <= values[known[0]]:
        raise NotObservableError(f"the method {name} found no increasing response in this series")
    rising = np.asarray(isotonic_regression(values[known]).x)
    slope = np.polyfit(known[-_END_LEVELS:], rising[-_END_LEVELS:], 1)[0]
    top = rising[-1] + max(float(slope), 0.0) * (255 - known[-1])
    table = np.interp(levels, [0, *known, 255], [0, *rising, top]) / top
    return Response.from_values(table + _LEAST_SLOPE * levels, model={"name": name})
