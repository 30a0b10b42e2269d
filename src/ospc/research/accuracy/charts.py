"""Real cameras in front of a colour chart: the response of each colour channel from four exposures alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, OspcError
from ospc.evaluation.metrics import response_shape_rmse
from ospc.photometry.geometry import pixel_grid
from ospc.recording import Frame
from ospc.recording.arrays import ArrayRecording
from ospc.research.accuracy.chart_photographs import (
    CHANNELS,
    EXPOSURES,
    ILLUMINANTS,
    ChartSeries,
    TrueResponse,
    read_series,
    true_response,
)
from ospc.research.held_out import HeldOut, HeldOutPair
from ospc.research.scoring import Truth
from ospc.research.source import Source

FOLDER = "chart_cameras"
"""Name of the folder of all cameras in the folder of real data."""

_STATED_MS = tuple(2.0**step for step in range(EXPOSURES))
"""The exposures that the series is said to have: each twice the one before."""

_DARKEST, _BRIGHTEST = 5, 250
"""Grey values outside of which a pixel counts as clipped."""


@dataclass(frozen=True)
class ChartSource(Source):
    """One colour channel of one camera.

    Methods get the JPEGs under the first illuminant with the stated exposures; the RAW files give the truth. Exposure
    factors are predicted for the JPEGs under the second illuminant.

    Attributes
    ----------
    folder
        The camera's photographs.
    channel
        Index into :data:`~ospc.research.accuracy.chart_photographs.CHANNELS`.
    """

    folder: Path
    channel: int

    @classmethod
    def of(cls, folder: Path, channel: int) -> ChartSource:
        """Return a channel of a camera, by the names of both."""
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
        return {"kind": "chart", "camera": self.folder.name, "channel": self.channel, "sha256": total.hexdigest()}

    def frames(self) -> Iterator[Frame]:
        """Give the JPEGs under the first illuminant."""
        planes = self._planes(self._fitted())
        return iter(ArrayRecording(list(planes), _STATED_MS, name=self.name, max_grey=255))

    def truth(self) -> Truth:
        """Return the response that the RAW files show."""
        known = true_response(self._fitted(), self.channel)
        return Truth(known.response, greys=known.greys, limits=self._limits(known))

    def held_out(self) -> HeldOut:
        """Return every two exposures under the second illuminant, with the ratio that the RAW files show."""
        series = read_series(self.folder, ILLUMINANTS[1])
        exposures, _ = series.irradiance()
        planes = self._planes(series)
        pairs = [
            _same_places(planes, first, second, float(exposures[first] / exposures[second]))
            for first, second in combinations(range(EXPOSURES), 2)
        ]
        return HeldOut(pairs, pairs)

    def known_pixels(self) -> list[HeldOutPair]:
        """Return the pixels of successive exposures for fitting, with the stated ratio."""
        planes = self._planes(self._fitted())
        return [_same_places(planes, i, j, _STATED_MS[i] / _STATED_MS[j]) for i, j in pairwise(range(EXPOSURES))]

    def _fitted(self) -> ChartSeries:
        return read_series(self.folder, ILLUMINANTS[0])

    def _planes(self, series: ChartSeries) -> FloatArray:
        return np.ascontiguousarray(series.jpeg[..., self.channel])

    def _limits(self, known: TrueResponse) -> dict[str, float]:
        """Return the difference of the truths under the two illuminants, and the error of the stated exposures."""
        exposures = self._fitted().irradiance()[0]
        limits = {"worst_exposure_error_percent": float(100 * np.max(np.abs(exposures / np.array(_STATED_MS) - 1)))}
        try:
            again = true_response(read_series(self.folder, ILLUMINANTS[1]), self.channel)
        except OspcError:
            return limits
        greys = max(known.greys[0], again.greys[0]), min(known.greys[1], again.greys[1])
        return limits | {"truth_uncertainty": response_shape_rmse(again.response, known.response, *greys)}


def _same_places(planes: FloatArray, first: int, second: int, ratio: float) -> HeldOutPair:
    """Return the pixels that neither of two exposures clips."""
    exposed = (planes > _DARKEST) & (planes < _BRIGHTEST)
    kept = exposed[first] & exposed[second]
    places = pixel_grid((planes.shape[2], planes.shape[1]))[kept]
    return HeldOutPair(planes[first][kept] / 255, planes[second][kept] / 255, places, places, ratio)


def chart_sources(folder: Path) -> list[ChartSource]:
    """Return every channel of the cameras in a folder; there must be one."""
    cameras = sorted(p for p in folder.iterdir() if (p / "wb1i1e1-jpg.png").is_file())
    if not cameras:
        raise FormatError(f"{folder}: holds no folder with wb1i1e1-jpg.png; give the folder of real data as it came")
    return [ChartSource.of(camera, channel) for camera in cameras for channel in range(len(CHANNELS))]
