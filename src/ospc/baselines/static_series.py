"""Responses from a camera that stands still while its exposure changes: four published methods.

All of them know the exposures and nothing else; none says anything about the vignette, which every pixel keeps for
itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import isotonic_regression

from ospc.arrays import BoolArray, FloatArray
from ospc.errors import FrameError, NotObservableError, SettingError
from ospc.photometry.response import Response
from ospc.recording.frame import Frame

_LEVELS = 256
_LEAST_SLOPE = 1e-9
_LEAST_CHANGE = 1.05
_DARKEST, _BRIGHTEST, _FEWEST_LEVELS, _END_LEVELS = 3, 250, 20, 10


@dataclass(frozen=True)
class ExposureSeries:
    """Images of one view at several exposures.

    Attributes
    ----------
    images
        Grey levels of 8 bit, shape (n, height, width), uint8.
    exposures_ms
        Shape (n,).
    """

    images: npt.NDArray[np.uint8]
    exposures_ms: FloatArray

    def __post_init__(self) -> None:
        """Refuse what is no series."""
        if self.images.ndim != 3 or self.images.dtype != np.uint8 or len(self.images) != len(self.exposures_ms):
            raise FrameError("a series has images of 8 bit and one size, and one exposure each")
        if not np.all(np.isfinite(self.exposures_ms) & (self.exposures_ms > 0)):
            raise SettingError("the exposures of a series must be finite and above 0")
        if len(self.images) < 2 or self.exposures_ms.max() < _LEAST_CHANGE * self.exposures_ms.min():
            raise NotObservableError("the exposures of a series must change by 5 % or more to show a response")

    @classmethod
    def of(cls, frames: Iterable[Frame], most: int = 24) -> ExposureSeries:
        """Choose frames whose exposures are spread evenly over their range, darkest first.

        Parameters
        ----------
        frames
            Of a camera that stands still.
        most
            How many are kept.
        """
        taken = sorted(frames, key=lambda frame: frame.exposure_ms)
        if len(taken) > most:
            logs = np.log([frame.exposure_ms for frame in taken])
            wanted = np.linspace(logs[0], logs[-1], most)
            taken = [taken[i] for i in sorted({int(np.argmin(np.abs(logs - w))) for w in wanted})]
        images = [
            np.rint(f.image * (255 / f.max_grey)).astype(np.uint8) if f.max_grey != 255 else f.image for f in taken
        ]
        if len({image.shape for image in images}) > 1:
            raise FrameError("the images of a series must have one size")
        return cls(np.asarray(images, dtype=np.uint8), np.array([f.exposure_ms for f in taken]))

    def sampled(self, count: int, seed: int = 0) -> npt.NDArray[np.uint8]:
        """Return some pixels in all images, spread evenly over their brightness, shape (n, count).

        Pixels that are saturated in an image are left out as long as enough others are there.
        """
        flat = self.images.reshape(len(self.images), -1)
        whole = flat.max(axis=0) < _LEVELS - 1
        flat = flat[:, whole] if np.count_nonzero(whole) >= min(count, 100) else flat
        order = np.argsort(flat.sum(axis=0, dtype=np.int64) + np.random.default_rng(seed).random(flat.shape[1]))
        sums = flat.sum(axis=0, dtype=np.int64)[order]
        places = np.searchsorted(sums, np.linspace(sums[0], sums[-1], count))
        chosen = order[np.unique(np.clip(places, 0, len(order) - 1))]
        return np.asarray(flat[:, chosen])


def debevec_malik(series: ExposureSeries, samples: int = 200, smoothness: float = 10.0) -> Response:
    """Return the response by Debevec and Malik 1997: ln g as 256 free values with a smoothness term; OpenCV's own.

    Parameters
    ----------
    series
        The images.
    samples
        Number of pixels used.
    smoothness
        λ of the publication.
    """
    chosen = series.sampled(samples)
    columns = [np.ascontiguousarray(row[None, :, None].repeat(3, axis=2)) for row in chosen]
    method = cv2.createCalibrateDebevec(chosen.shape[1], smoothness, False)
    return _of_table(_solved(method, columns, series), "debevec-malik")


def robertson(series: ExposureSeries, iterations: int = 60) -> Response:
    """Return the response by Robertson et al. 2003: 256 free values, every pixel's radiance in turn; OpenCV's own."""
    images = [np.ascontiguousarray(image[:, :, None].repeat(3, axis=2)) for image in series.images]
    method = cv2.createCalibrateRobertson(iterations, 0.0)
    return _of_table(_solved(method, images, series), "robertson")


def _solved(method: cv2.CalibrateCRF, images: list[npt.NDArray[np.uint8]], series: ExposureSeries) -> FloatArray:
    times = np.asarray(series.exposures_ms / series.exposures_ms.mean(), dtype=np.float32)
    found = np.asarray(method.process(images, times), dtype=np.float64)
    return np.asarray(found.reshape(_LEVELS, -1)[:, 0])


@dataclass(frozen=True)
class MitsunagaNayar:
    """What radiometric self calibration found.

    Attributes
    ----------
    coefficients
        c₀ … c_N of g(M) = Σ cₙMⁿ.
    ratios
        Exposure of each image over that of the next, shape (n − 1,).
    error
        Root mean square of g(M₁) − R·g(M₂).
    """

    coefficients: FloatArray
    ratios: FloatArray
    error: float

    @property
    def response(self) -> Response:
        """The polynomial as a response."""
        levels = np.linspace(0, 1, _LEVELS)
        values = np.polynomial.polynomial.polyval(levels, self.coefficients)
        return _of_table(np.asarray(values - values[0]), "mitsunaga-nayar")


def mitsunaga_nayar(
    series: ExposureSeries,
    *,
    degree: int | None = None,
    samples: int = 2000,
    refine_ratios: bool = False,
    iterations: int = 100,
) -> MitsunagaNayar:
    """Return the response by Mitsunaga and Nayar 1999: a polynomial, and exposure ratios better than those given.

    Parameters
    ----------
    series
        The images.
    degree
        Of the polynomial; the one of 1 to 10 with the least error where None, as the publication chooses it.
    samples
        Number of pixels used.
    refine_ratios
        Whether exposure ratios are estimated in turn with the response, from those given. The publication does so
        for ratios that are known roughly; response and ratios then are known up to an exponent only.
    iterations
        Most turns.

    Raises
    ------
    SettingError
        If the degree is not between 1 and 10.
    NotObservableError
        If too few pixels are exposed in two successive images.
    """
    if degree is not None and not 1 <= degree <= 10:
        raise SettingError(f"the degree of the polynomial is {degree}; choose one from 1 to 10")
    grey = series.sampled(samples).astype(np.float64)
    exposed = (grey > 2) & (grey < 253)
    pairs = exposed[:-1] & exposed[1:]
    if np.count_nonzero(pairs) < 50:
        raise NotObservableError("hardly any pixel is exposed in two successive images; take smaller steps")
    first, second = grey[:-1] / 255, grey[1:] / 255
    start = series.exposures_ms[:-1] / series.exposures_ms[1:]
    degrees = range(1, 11) if degree is None else (degree,)
    turns = iterations if refine_ratios else 1
    found = [_polynomial((first, second), pairs, start, n, turns) for n in degrees]
    return min(found, key=lambda result: result.error)


def _polynomial(
    grey: tuple[FloatArray, FloatArray], pairs: BoolArray, ratios: FloatArray, degree: int, turns: int
) -> MitsunagaNayar:
    """Solve for c₀ … c_{N−1} with c_N = 1 − Σ c, then for the ratios, until neither changes."""
    power = np.arange(degree + 1)
    image = np.nonzero(pairs)[0]
    a, b = (part[pairs][:, None] ** power for part in grey)
    previous: FloatArray | None = None
    coefficients = np.zeros(degree + 1)
    for _ in range(turns):
        d = a - ratios[image, None] * b
        free = np.linalg.lstsq(d[:, :-1] - d[:, -1:], -d[:, -1], rcond=None)[0]
        coefficients = np.append(free, 1 - free.sum())
        if previous is not None and np.max(np.abs(coefficients - previous)) < 1e-6:
            break
        previous = coefficients
        if turns > 1:
            g1, g2 = a @ coefficients, b @ coefficients
            valid = (g1 > 1e-3) & (g2 > 1e-3)
            totals = np.bincount(image[valid], weights=(g1 / np.maximum(g2, 1e-3))[valid], minlength=len(ratios))
            counts = np.bincount(image[valid], minlength=len(ratios))
            ratios = np.where(counts > 0, totals / np.maximum(counts, 1), ratios)
    d = a - ratios[image, None] * b
    return MitsunagaNayar(coefficients, ratios, float(np.sqrt(np.mean((d @ coefficients) ** 2))))


def engel_response(series: ExposureSeries, iterations: int = 20) -> Response:
    """Return the response by Engel et al. 2016: g as 256 free values and every pixel's irradiance B in turn.

    Minimises Σ (g(Mᵢ(x)) − tᵢB(x))² over unsaturated pixels: g(m) is the mean of tᵢB(x) where Mᵢ(x) = m, and
    B(x) = Σ tᵢ g(Mᵢ(x)) / Σ tᵢ².

    Parameters
    ----------
    series
        The images.
    iterations
        Turns.
    """
    t = (series.exposures_ms / series.exposures_ms.mean())[:, None]
    grey = series.images.reshape(len(series.images), -1)
    used = grey < 255
    weight = np.where(used, t, 0.0)
    square = np.maximum((weight * t).sum(axis=0), 1e-12)
    table: FloatArray = np.arange(_LEVELS, dtype=np.float64)
    counts = np.bincount(grey[used], minlength=_LEVELS)
    for _ in range(iterations):
        irradiance = (weight * table[grey]).sum(axis=0) / square
        sums = np.bincount(grey[used], weights=(t * irradiance)[used], minlength=_LEVELS)
        table = sums / np.maximum(counts, 1)
        table *= 255 / max(float(table.max()), 1e-12)
    return _of_table(np.where(counts > 0, table, np.nan), "engel")


def _of_table(values: FloatArray, name: str) -> Response:
    """Return values of g, NaN where unknown, as a response.

    The ends, where saturation and noise rule, are left to the others: a line to the origin below, the slope of the
    brightest known levels above. In between, gaps are interpolated, and where noise made the curve fall it becomes
    the nearest that does not, by least squares.
    """
    levels = np.arange(_LEVELS)
    known = np.flatnonzero(np.isfinite(values) & (values > 0) & (levels >= _DARKEST) & (levels <= _BRIGHTEST))
    if known.size < _FEWEST_LEVELS or values[known[-1]] <= values[known[0]]:
        raise NotObservableError(f"the method {name} found no increasing response in this series")
    rising = np.asarray(isotonic_regression(values[known]).x)
    slope = np.polyfit(known[-_END_LEVELS:], rising[-_END_LEVELS:], 1)[0]
    top = rising[-1] + max(float(slope), 0.0) * (_LEVELS - 1 - known[-1])
    table = np.interp(levels, [0, *known, _LEVELS - 1], [0, *rising, top]) / top
    return Response.from_values(table + _LEAST_SLOPE * levels, model={"name": name})
