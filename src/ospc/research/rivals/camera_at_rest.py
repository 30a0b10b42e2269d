"""What the methods for a camera at rest share: images at several exposures, and a response from values of g.

They need all images at once, and find no vignette.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

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

_LEAST_CHANGE = 1.05
"""Least ratio of the largest exposure to the smallest."""

_LEAST_SLOPE = 1e-9
"""Growth of g from one grey level to the next where its estimate is flat."""

_DARKEST, _BRIGHTEST = 3, 250
"""Grey levels between which the values of g are used; beyond, saturation and noise distort them."""

_FEWEST_LEVELS, _END_LEVELS = 20, 10
"""Grey levels that must have a value, and number of those that g is extended from."""

_MOST_IMAGES = 24
"""Images of a series: enough for every method, few enough for memory."""

_FEWEST_UNSATURATED = 100


@dataclass(frozen=True)
class ExposureSeries:
    """Images of one view at several exposures.

    Attributes
    ----------
    images
        Grey levels of 8 bits, shape (n, height, width), uint8.
    exposures_ms
        Shape (n,).
    """

    images: npt.NDArray[np.uint8]
    exposures_ms: FloatArray

    def __post_init__(self) -> None:
        """Check that it is a series."""
        if self.images.ndim != 3 or self.images.dtype != np.uint8 or len(self.images) != len(self.exposures_ms):
            raise FrameError("a series has 8-bit images of one size, and one exposure for each")
        if not np.all(np.isfinite(self.exposures_ms) & (self.exposures_ms > 0)):
            raise SettingError("the exposures of a series must be finite and above 0")
        if len(self.images) < 2 or self.exposures_ms.max() < _LEAST_CHANGE * self.exposures_ms.min():
            raise NotObservableError("the exposures of a series must change by 5 % or more to show a response")

    @classmethod
    def of(cls, frames: Iterable[Frame], most: int = _MOST_IMAGES) -> ExposureSeries:
        """Select ``most`` frames at most whose exposures are spread evenly over their range, darkest first."""
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
        """Return some pixels in all images, spread evenly over their brightness, shape (n, count).

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

    The ends are replaced: below by a line to the origin, above by the slope of the brightest known levels. In
    between, gaps are interpolated, and where noise made the curve fall, the nearest curve that does not is taken, by
    least squares.

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
    """A method for a camera at rest, as studies run it, and the name of its outcome."""

    def __init__(self, name: str, response_of: Callable[[ExposureSeries], Response]) -> None:
        self._name, self._response_of = name, response_of
        self._frames: list[Frame] = []

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._frames.append(frame)

    def found(self) -> dict[str, Outcome]:
        """Return the response."""
        return {self._name: Estimate(self._response_of(ExposureSeries.of(self._frames)))}
