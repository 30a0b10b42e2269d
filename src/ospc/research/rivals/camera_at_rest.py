"""Methods of OpenCV for a static camera: the response from images of one view at several exposures.

They need all images at once and estimate no vignette.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import isotonic_regression

from ospc.arrays import FloatArray
from ospc.errors import FrameError, NotObservableError, SettingError
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome

LEVELS = 256
"""Grey levels of 8-bit images."""

_LEAST_CHANGE, _LEAST_SLOPE = 1.05, 1e-9
"""Least ratio of the largest to the smallest exposure, and step of g per level where it would be flat."""

_DARKEST, _BRIGHTEST = 3, 250
"""Range of grey levels in which g is used; saturation and noise distort it elsewhere."""

_FEWEST_LEVELS, _END_LEVELS = 20, 10
"""Grey levels that must have a value, and number of those from which g is extrapolated."""

_MOST_IMAGES, _FEWEST_UNSATURATED = 24, 100
"""Images of a series, enough for every method and few enough for memory, and never-saturated pixels that suffice."""


@dataclass(frozen=True)
class ExposureSeries:
    """8-bit images of one view, shape (n, height, width), and their exposures, shape (n,)."""

    images: npt.NDArray[np.uint8]
    exposures_ms: FloatArray

    def __post_init__(self) -> None:
        """Check sizes and exposures."""
        if self.images.ndim != 3 or self.images.dtype != np.uint8 or len(self.images) != len(self.exposures_ms):
            raise FrameError("a series has 8-bit images of one size, and one exposure for each")
        if not np.all(np.isfinite(self.exposures_ms) & (self.exposures_ms > 0)):
            raise SettingError("the exposures of a series must be finite and above 0")
        if len(self.images) < 2 or self.exposures_ms.max() < _LEAST_CHANGE * self.exposures_ms.min():
            raise NotObservableError("the exposures of a series must change by 5 % or more to show a response")

    @classmethod
    def of(cls, frames: Iterable[Frame], most: int = _MOST_IMAGES) -> ExposureSeries:
        """Select at most ``most`` frames with exposures spread evenly over their range, darkest first."""
        taken = sorted(frames, key=lambda frame: frame.exposure_ms)
        if len(taken) > most:
            logs = np.log([frame.exposure_ms for frame in taken])
            wanted = np.linspace(logs[0], logs[-1], most)
            taken = [taken[i] for i in sorted({int(np.argmin(np.abs(logs - w))) for w in wanted})]
        images = [frame.image_8_bit for frame in taken]
        if len({image.shape for image in images}) > 1:
            raise FrameError("the images of a series must have one size")
        return cls(np.asarray(images, dtype=np.uint8), np.array([f.exposure_ms for f in taken]))

    @property
    def relative_exposures(self) -> FloatArray:
        """Exposures with a mean of 1, shape (n,)."""
        return np.asarray(self.exposures_ms / self.exposures_ms.mean())

    def sampled(self, count: int) -> npt.NDArray[np.uint8]:
        """Return up to ``count`` pixels in all images, spread evenly over brightness, shape (n, count).

        Pixels that are saturated in any image are left out if enough others remain.
        """
        flat = self.images.reshape(len(self.images), -1)
        whole = flat.max(axis=0) < LEVELS - 1
        flat = flat[:, whole] if np.count_nonzero(whole) >= min(count, _FEWEST_UNSATURATED) else flat
        order = np.argsort(flat.sum(axis=0, dtype=np.int64) + np.random.default_rng(0).random(flat.shape[1]))
        sums = flat.sum(axis=0, dtype=np.int64)[order]
        places = np.searchsorted(sums, np.linspace(sums[0], sums[-1], count))
        chosen = order[np.unique(np.clip(places, 0, len(order) - 1))]
        return np.asarray(flat[:, chosen])


def response_of_values(values: FloatArray, name: str) -> Response:
    """Return 256 values of g, NaN where unknown, as a response.

    The ends are replaced: below by a line to the origin, above by the slope of the brightest known levels. Gaps are
    interpolated, and the curve is made non-decreasing by isotonic regression.

    Raises
    ------
    NotObservableError
        If too few values are known, or they do not increase.
    """
    levels = np.arange(LEVELS)
    known = np.flatnonzero(np.isfinite(values) & (values > 0) & (levels >= _DARKEST) & (levels <= _BRIGHTEST))
    if known.size < _FEWEST_LEVELS or values[known[-1]] <= values[known[0]]:
        raise NotObservableError(f"the method {name} found no increasing response in this series")
    rising = np.asarray(isotonic_regression(values[known]).x)
    slope = np.polyfit(known[-_END_LEVELS:], rising[-_END_LEVELS:], 1)[0]
    top = rising[-1] + max(float(slope), 0.0) * (LEVELS - 1 - known[-1])
    table = np.interp(levels, [0, *known, LEVELS - 1], [0, *rising, top]) / top
    return Response.from_values(table + _LEAST_SLOPE * levels, model={"name": name})


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
        return {self._name: Estimate(AT_REST[self._name](ExposureSeries.of(self._frames)))}


_SMOOTHNESS, _TURNS = 10.0, 60
"""λ of Debevec and Malik, OpenCV's default, and iterations of Robertson's method."""


def debevec_malik(series: ExposureSeries, samples: int = 200) -> Response:
    """Return the response of Debevec and Malik, "Recovering high dynamic range radiance maps from photographs", 1997.

    OpenCV's implementation, on this number of pixels. ln g has 256 free values. Minimises
    Σ w(M)² (ln g(Mᵢₚ) − ln Eₚ − ln tᵢ)² + λ Σ w(M)² (second difference of ln g)², linear in all unknowns, with a
    triangular weight w.
    """
    chosen = series.sampled(samples)
    method = cv2.createCalibrateDebevec(chosen.shape[1], _SMOOTHNESS, False)
    return _by_opencv(method, chosen[:, None], series, "debevec-malik")


def robertson(series: ExposureSeries) -> Response:
    """Return the response of Robertson et al., "Estimation-theoretic approach to dynamic range enhancement …", 2003.

    OpenCV's implementation. g has 256 free values. Minimises Σ w(M) (g(Mᵢₚ) − tᵢEₚ)² for g and the irradiances E in
    turn, with a weight w that falls towards both ends like a normal distribution.
    """
    return _by_opencv(cv2.createCalibrateRobertson(_TURNS, 0.0), series.images, series, "robertson")


def _by_opencv(method: Any, images: npt.NDArray[np.uint8], series: ExposureSeries, name: str) -> Response:
    colour = [np.ascontiguousarray(image[:, :, None].repeat(3, axis=2)) for image in images]
    found = method.process(colour, series.relative_exposures.astype(np.float32))
    return response_of_values(np.asarray(found, dtype=np.float64).reshape(LEVELS, -1)[:, 0], name)


AT_REST: dict[str, Callable[[ExposureSeries], Response]] = {
    "debevec-malik": debevec_malik,
    "robertson": robertson,
}
"""The methods by name."""
