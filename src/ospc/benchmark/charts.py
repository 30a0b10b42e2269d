"""Real cameras in front of a colour chart as cases: the response of each colour channel from four exposures alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.benchmark.case import Group, OnProgress, Row
from ospc.benchmark.chart_photographs import (
    CHANNELS,
    EXPOSURES,
    ILLUMINANTS,
    ChartSeries,
    TrueResponse,
    read_series,
    true_response,
)
from ospc.benchmark.held_out import HeldOutPair, predicted_ratio
from ospc.benchmark.running import run_preset
from ospc.benchmark.scoring import score, with_figures
from ospc.errors import FormatError, OspcError
from ospc.evaluation.metrics import response_shape_rmse
from ospc.methods.paper import Correspondences, in_order, polynomial_response, response_rows, solve_response
from ospc.photometry.calibration import Calibration
from ospc.photometry.geometry import pixel_grid
from ospc.recording.arrays import ArrayRecording

FOLDER = "chart_cameras"
_STATED_MS = tuple(2.0**step for step in range(EXPOSURES))
"""What the series is said to be: each exposure twice the one before."""
_DARKEST, _BRIGHTEST = 5, 250


@dataclass(frozen=True)
class ChartCase:
    """One colour channel of one camera.

    The response is estimated from the JPEGs under the first illuminant and the stated exposures; the truth is from
    the RAW files. Exposure factors are predicted for the JPEGs under the second illuminant.

    Attributes
    ----------
    folder
        The camera's photographs.
    channel
        Index into :data:`~ospc.benchmark.chart_photographs.CHANNELS`.
    """

    folder: Path
    channel: int

    @property
    def name(self) -> str:
        """Camera and channel."""
        return f"chart-{self.folder.name}-{CHANNELS[self.channel]}"

    @property
    def group(self) -> Group:
        """``charts``."""
        return "charts"

    @property
    def factors(self) -> dict[str, str]:
        """Camera and channel."""
        return {"camera": self.folder.name, "channel": CHANNELS[self.channel]}

    def describe(self) -> dict[str, Any]:
        """Return a hash of the photographs."""
        total = sha256()
        for illuminant in ILLUMINANTS:
            series = read_series(self.folder, illuminant)
            total.update(series.jpeg.tobytes() + series.raw.tobytes() + series.patches.tobytes())
        return {"kind": "chart", "camera": self.folder.name, "channel": self.channel, "sha256": total.hexdigest()}

    def rows(self, preset: str, progress: OnProgress) -> list[Row]:
        """Run every method of a preset.

        With "paper" comes a row of its estimator on pixels that are known to correspond, since a chart without
        texture has no features to speak of.
        """
        fitted, other = (read_series(self.folder, illuminant) for illuminant in ILLUMINANTS)
        recording = ArrayRecording(list(_plane(fitted, self.channel)), _STATED_MS, name=self.name, max_grey=255)
        found = run_preset(preset, recording, EXPOSURES, progress, solvers=None)
        if preset == "paper":
            found["paper, pixels known"] = _quadratic_on_known_pixels(fitted, self.channel)
        truth, pairs = true_response(fitted, self.channel), _held_out(other, self.channel)
        limits = _limits(fitted, other, truth, self.channel)
        return [
            replace(_judged(method, outcome, truth, pairs), limits=limits)
            if isinstance(outcome, Calibration)
            else Row(method, failure=outcome, limits=limits)
            for method, outcome in found.items()
        ]


def _judged(method: str, found: Calibration, truth: TrueResponse, pairs: list[HeldOutPair]) -> Row:
    row = score(method, found, truth.response, None, pairs=pairs, greys=truth.greys)
    if found.response is None or not pairs:
        return row
    ratios = [(predicted_ratio(p, found.response, None), p.exposure_ratio) for p in pairs]
    return with_figures(
        row, factor_error_percent=float(np.median([abs(found / true - 1) * 100 for found, true in ratios]))
    )


def _limits(fitted: ChartSeries, other: ChartSeries, truth: TrueResponse, channel: int) -> dict[str, float]:
    """Return how far the truths under the two illuminants are apart, and how far the exposures from those stated."""
    measured = fitted.irradiance()[0]
    limits = {"worst_exposure_error_percent": float(100 * np.max(np.abs(measured / np.array(_STATED_MS) - 1)))}
    try:
        again = true_response(other, channel)
    except OspcError:
        return limits
    greys = max(truth.greys[0], again.greys[0]), min(truth.greys[1], again.greys[1])
    return limits | {"truth_uncertainty": response_shape_rmse(again.response, truth.response, *greys)}


def _held_out(series: ChartSeries, channel: int) -> list[HeldOutPair]:
    """Return every two exposures with the ratio that the RAW shows."""
    exposures, _ = series.irradiance()
    planes = _plane(series, channel)
    return [
        _same_places(planes, first, second, float(exposures[first] / exposures[second]))
        for first, second in combinations(range(EXPOSURES), 2)
    ]


def _quadratic_on_known_pixels(series: ChartSeries, channel: int) -> Calibration | str:
    planes = _plane(series, channel)
    height, width = planes.shape[1:]
    gram = np.zeros((3, 3))
    for first, second in pairwise(range(EXPOSURES)):
        stated = _STATED_MS[first] / _STATED_MS[second]
        pair = _same_places(planes, first, second, stated)
        pixels = Correspondences((first, second), (width, height), pair.points0, pair.points1, pair.grey0, pair.grey1)
        rows = response_rows(in_order(pixels, stated), stated)
        gram += rows.T @ rows
    coefficients = solve_response(gram, "when needed")
    if coefficients is None:
        return "NotObservableError: the quadratic does not increase"
    return Calibration(size=(width, height), response=polynomial_response(coefficients))


def _same_places(planes: FloatArray, first: int, second: int, ratio: float) -> HeldOutPair:
    kept = (planes[first] > _DARKEST) & (planes[second] < _BRIGHTEST)
    kept &= (planes[second] > _DARKEST) & (planes[first] < _BRIGHTEST)
    places = pixel_grid((planes.shape[2], planes.shape[1]))[kept]
    return HeldOutPair(planes[first][kept] / 255, planes[second][kept] / 255, places, places, ratio)


def _plane(series: ChartSeries, channel: int) -> FloatArray:
    return np.ascontiguousarray(series.jpeg[..., channel])


def chart_cases(data: Path | None) -> tuple[list[ChartCase], str]:
    """Return the cameras of the folder of real data, or a note on why there are none.

    Raises
    ------
    FormatError
        If the folder holds no camera.
    """
    if data is None:
        return [], "--data is not given: no photographs of charts"
    place = data / FOLDER
    if not place.is_dir():
        return [], f"{place} is not there: no photographs of charts"
    cameras = sorted(p for p in place.iterdir() if (p / "wb1i1e1-jpg.png").is_file())
    if not cameras:
        raise FormatError(f"{place}: holds no folder with wb1i1e1-jpg.png; give the folder of real data as it came")
    return [ChartCase(camera, channel) for camera in cameras for channel in range(len(CHANNELS))], ""
