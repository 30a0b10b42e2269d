"""Real cameras in front of a colour chart: the response of each colour channel from four exposures.

The truth comes from the RAW files. The sensor is linear, so RAW values are proportional to irradiance. A camera mixes
colours before its tone curve; on the neutral patches this is only a factor, so JPEG against RAW values gives the
response up to scale.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import isotonic_regression

from ospc.arrays import FloatArray, Image, IntArray, size_of
from ospc.errors import FormatError, OspcError
from ospc.evaluation.metrics import response_shape_rmse
from ospc.formats.files import read_bytes, read_text
from ospc.photometry.geometry import pixel_grid
from ospc.photometry.response import Response
from ospc.recording import Frame
from ospc.recording.channel import Channel
from ospc.recording.image_source import decode_stored
from ospc.recording.recording import ArrayRecording
from ospc.research.scoring import HeldOutPair, Truth
from ospc.research.source import Source

EXPOSURES = 4
ILLUMINANTS = (1, 2)
CHANNELS = ("blue", "green", "red")
"""The channels in the order of decoded images."""
_MAX_BYTES, _MAX_TAGS_BYTES = 64 * 2**20, 2**20
"""Size limits of a photograph and of the list of patches."""
_NEUTRAL, _HALF_WINDOW_PX = 6, 12
"""Number of neutral patches, and half the side of the window read in the middle of a patch."""
_CLIPPED, _DARKEST_RAW = 245, 4.0
"""RAW values from which a pixel may be clipped, and below which quantisation matters."""
_ROUNDS = 30
"""Alternations of fitting the exposures and the radiances."""
_DARKEST, _BRIGHTEST = 5, 250
"""Grey values between which responses are compared (the shape metric), and beyond which a pixel is clipped."""


@dataclass(frozen=True)
class ChartSeries:
    """Four exposures of the chart under one illuminant, shortest first: JPEG and RAW, shape (4, height, width, 3).

    Channels are :data:`CHANNELS`; patches are centres (x, y) in pixels, shape (n, 2), with the neutral ones last.
    """

    jpeg: Image
    raw: Image
    patches: IntArray

    def patch_values(self, images: Image) -> tuple[FloatArray, FloatArray]:
        """Return mean and largest value of every patch, shape (4, patches, 3) each."""
        w = _HALF_WINDOW_PX
        windows = [images[:, max(y - w, 0) : y + w + 1, max(x - w, 0) : x + w + 1] for x, y in self.patches]
        mean = np.stack([p.mean(axis=(1, 2), dtype=np.float64) for p in windows], axis=1)
        largest = np.stack([p.max(axis=(1, 2)) for p in windows], axis=1)
        return mean, largest.astype(np.float64)

    def irradiance(self) -> tuple[FloatArray, FloatArray]:
        """Return relative exposures, shape (4,), and radiances, shape (patches, 3), from the RAW values.

        Their product is fitted to the values that are neither clipped nor dominated by quantisation, so that dark
        patches gain precision from the longer exposures.
        """
        mean, largest = self.patch_values(self.raw)
        weight = np.where((largest < _CLIPPED) & (mean > _DARKEST_RAW), mean**2, 0.0)
        log_raw = np.log(np.maximum(mean, 1e-3))
        log_exposure = np.arange(EXPOSURES) * np.log(2)
        log_radiance = np.zeros(mean.shape[1:])
        for _ in range(_ROUNDS):
            total = np.maximum(weight.sum(axis=0), 1e-12)
            log_radiance = (weight * (log_raw - log_exposure[:, None, None])).sum(axis=0) / total
            residual = weight * (log_raw - log_radiance)
            log_exposure = residual.sum(axis=(1, 2)) / np.maximum(weight.sum(axis=(1, 2)), 1e-12)
        radiance = np.where(weight.sum(axis=0) > 0, np.exp(log_radiance), np.nan)
        return np.exp(log_exposure - log_exposure[0]), radiance * np.exp(log_exposure[0])


def read_series(folder: Path, illuminant: int) -> ChartSeries:
    """Read the photographs of one camera under one illuminant; ``tags.json`` next to the folder lists the patches."""
    jpeg, raw = (
        [_read(folder / f"wb1i{illuminant}e{e + 1}-{kind}.png") for e in range(EXPOSURES)] for kind in ("jpg", "raw")
    )
    if len({image.shape for image in (*jpeg, *raw)}) != 1:
        raise FormatError(f"{folder}: the photographs differ in size")
    height, width = jpeg[0].shape[:2]
    return ChartSeries(np.stack(jpeg), np.stack(raw), _patches(folder.parent / "tags.json", width, height))


def true_response(series: ChartSeries, channel: int) -> tuple[Response, tuple[int, int]]:
    """Return the response from JPEG against RAW values, and the grey values between which it was measured.

    An increasing curve in ln irradiance interpolates the neutral patches that are clipped in neither JPEG nor RAW.
    """
    exposures, radiance = series.irradiance()
    mean, largest = series.patch_values(series.jpeg)
    grey = mean[:, -_NEUTRAL:, channel]
    light = exposures[:, None] * radiance[-_NEUTRAL:, channel]
    kept = (largest[:, -_NEUTRAL:, channel] < 255) & (grey > 0) & np.isfinite(light)
    grey, light = grey[kept], light[kept]
    if len(grey) < _NEUTRAL:
        raise FormatError(f"only {len(grey)} neutral patches of the chart are well exposed, {_NEUTRAL} are needed")
    grey, curve = _increasing(grey, np.log(light))
    inside = np.arange(np.ceil(grey[0]), np.floor(grey[-1]) + 1)
    light = np.exp(PchipInterpolator(grey, curve)(inside))
    table = np.interp(np.arange(256), np.append(0.0, inside), np.append(0.0, light))
    above = np.arange(256) > inside[-1]
    table[above] = light[-1] + (np.arange(256)[above] - inside[-1]) * (light[-1] - light[-2])
    return Response.from_values(table), (max(_DARKEST, int(inside[0])), min(_BRIGHTEST, int(inside[-1])))


def _increasing(grey: FloatArray, log_light: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the knots of the increasing curve nearest to the points."""
    order = np.lexsort((log_light, grey))
    fitted = isotonic_regression(log_light[order]).x
    # Levels made equal by the regression, and equal greys, become one knot, so that the curve increases strictly.
    member = np.cumsum(np.append(0, (np.diff(fitted) > 0) & (np.diff(grey[order]) > 0)))
    count = np.bincount(member)
    return np.bincount(member, grey[order]) / count, np.bincount(member, fitted) / count


def _read(path: Path) -> Image:
    image = decode_stored(read_bytes(path, _MAX_BYTES), str(path), Channel.ALL).pixels
    if image.dtype != np.uint8 or image.ndim != 3:
        raise FormatError(f"{path}: not an 8-bit colour image")
    return image


def _patches(path: Path, width: int, height: int) -> IntArray:
    try:
        tags = json.loads(read_text(path, _MAX_TAGS_BYTES))
        places = [[r["position"]["x"] * width, r["position"]["y"] * height] for r in tags[0]["references"]]
        centres = np.array(places, dtype=np.float64)
    except (ValueError, KeyError, IndexError, TypeError, RecursionError) as error:
        raise FormatError(f"{path}: does not list the patches' positions ({type(error).__name__}: {error})") from None
    inside = centres.ndim == 2 and np.all((centres >= 0) & (centres < [width, height]))
    if not inside or len(centres) < _NEUTRAL:
        raise FormatError(f"{path}: needs at least {_NEUTRAL} patches inside the images")
    return np.rint(centres).astype(np.int64)


CHARTS = "chart_cameras"
"""Name of the folder of all cameras in the folder of real data."""
_STATED_MS = tuple(2.0**step for step in range(EXPOSURES))
"""The nominal exposures of the series: each twice the one before."""


@dataclass(frozen=True)
class ChartSource(Source):
    """One colour channel of one camera.

    Methods get the JPEGs under the first illuminant with the nominal exposures; the RAW files give the truth.
    Exposure factors are predicted for the JPEGs under the second illuminant. ``channel`` is an index into
    :data:`CHANNELS`.
    """

    folder: Path
    channel: int

    @classmethod
    def of(cls, folder: Path, channel: int) -> ChartSource:
        """Return the source of one channel of a camera."""
        factors = {"camera": folder.name, "channel": CHANNELS[channel]}
        return cls(f"chart-{folder.name}-{CHANNELS[channel]}", folder, channel, group="charts", factors=factors)

    @property
    def count(self) -> int:
        """Number of exposures."""
        return EXPOSURES

    def describe(self) -> dict[str, Any]:
        """Return a hash of the photographs."""
        total = sha256()
        for illuminant in ILLUMINANTS:
            series = read_series(self.folder, illuminant)
            total.update(series.jpeg.tobytes() + series.raw.tobytes() + series.patches.tobytes())
        known = {"kind": "chart", "camera": self.folder.name, "channel": self.channel}
        return known | {"sha256": total.hexdigest()}

    def frames(self) -> Iterator[Frame]:
        """Iterate over the JPEGs under the first illuminant."""
        planes = np.ascontiguousarray(read_series(self.folder, ILLUMINANTS[0]).jpeg[..., self.channel])
        return iter(ArrayRecording(list(planes), _STATED_MS, name=self.name, max_grey=255))

    def truth(self) -> Truth:
        """Return the response from the RAW files.

        Its limits are the difference of the truths under both illuminants, and the error of the stated exposures.
        """
        series = read_series(self.folder, ILLUMINANTS[0])
        response, greys = true_response(series, self.channel)
        wrong = np.max(np.abs(series.irradiance()[0] / np.array(_STATED_MS) - 1))
        limits = {"worst_exposure_error_percent": 100 * float(wrong)}
        with suppress(OspcError):
            again, again_greys = true_response(read_series(self.folder, ILLUMINANTS[1]), self.channel)
            common = max(greys[0], again_greys[0]), min(greys[1], again_greys[1])
            limits["truth_uncertainty"] = response_shape_rmse(again, response, *common)
        return Truth(response, greys=greys, limits=limits)

    def held_out(self) -> Sequence[HeldOutPair]:
        """Return every two exposures under the second illuminant with the RAW ratio, at pixels that neither clips."""
        series = read_series(self.folder, ILLUMINANTS[1])
        exposures, _ = series.irradiance()
        planes = series.jpeg[..., self.channel]
        size = size_of(planes[0])
        exposed = (planes > _DARKEST) & (planes < _BRIGHTEST)
        pairs = []
        for first, second in combinations(range(EXPOSURES), 2):
            kept = exposed[first] & exposed[second]
            places, greys = pixel_grid(size)[kept], (planes[first][kept] / 255, planes[second][kept] / 255)
            ratio = float(exposures[first] / exposures[second])
            pairs.append(HeldOutPair((first, second), size, places, places, *greys, ratio))
        return pairs


def chart_sources(folder: Path) -> list[ChartSource]:
    """Return every channel of the cameras in a folder, which must contain at least one."""
    cameras = sorted(p for p in folder.iterdir() if (p / "wb1i1e1-jpg.png").is_file())
    if not cameras:
        raise FormatError(f"{folder}: has no folder with wb1i1e1-jpg.png; give the unchanged real data")
    return [ChartSource.of(camera, channel) for camera in cameras for channel in range(len(CHANNELS))]
