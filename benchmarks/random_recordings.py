"""Recordings without faults, drawn at random: any camera, scene, motion and exposure control."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ospc import Response
from ospc.research.accuracy.design import FILE, read_database
from ospc.research.source import SimulatedSource
from ospc.simulation import SimulationSettings
from ospc.simulation.responses import RESPONSES

_MEASURED, _KNEES = 0.5, 0.15
"""Share of measured responses, if there are any, and of piecewise linear ones."""

_GAMMAS = (1.3, 3.0)
"""Range of the exponents of gamma curves, which count as one of the simulator's responses."""

_STEEPER = (1.5, 6.0)
"""Range of the factor by which a knee makes g steeper."""

_CORNERS = (0.4, 1.0)
"""Range of V at the corner."""

_SWEPT = 6.0
"""Largest over smallest exposure of programmed ones."""


def recordings(
    count: int, seed: int, frames: tuple[int, int], measured: Sequence[Response] = ()
) -> list[SimulatedSource]:
    """Return the first recordings of a family; a larger count only adds to them.

    Their numbers of frames are drawn uniformly in the logarithm between the two given. ``measured`` are measured
    responses to choose from.
    """
    return [_recording(seed, number, frames, measured) for number in range(count)]


def measured_responses() -> list[Response]:
    """Return the measured responses in the folder of the environment variable OSPC_DATA; none without it."""
    folder = os.environ.get("OSPC_DATA")
    return read_database(Path(folder) / FILE) if folder else []


def _recording(seed: int, number: int, frames: tuple[int, int], measured: Sequence[Response]) -> SimulatedSource:
    random = np.random.default_rng([seed, number])
    count = round(_log_uniform(random, *frames))
    settings = SimulationSettings(
        size=((320, 240), (640, 480), (640, 480))[int(random.integers(3))],
        frames=count,
        seed=1000 * seed + number,
        response=_response(random, measured),
        vignette_coefficients=_vignette(random),
        full_well_electrons=round(_log_uniform(random, 3_000, 20_000), 0),
        read_noise_electrons=round(random.uniform(5, 12), 1),
        motion=("handheld", "handheld", "pan", "forward")[int(random.integers(4))],
        speed=round(random.uniform(0.6, 1.6), 2),
        horizontal_fov_deg=round(random.uniform(50, 95), 0),
        motion_blur_samples=(1, 1, 8)[int(random.integers(3))],
        moving_objects=(0, 0, 6)[int(random.integers(3))],
        **_exposure_control(random, count),
        **({}, {}, {"image_format": "jpg", "jpg_quality": 92}, {"bit_depth": 12})[int(random.integers(4))],
    )
    return SimulatedSource(f"{seed}-{number:03d}", settings)


def _log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return math.exp(random.uniform(math.log(low), math.log(high)))


def _response(random: np.random.Generator, measured: Sequence[Response]) -> str | Response:
    kind = random.uniform()
    if kind < _KNEES:
        return _piecewise_linear(random)
    if measured and kind < _KNEES + _MEASURED:
        return measured[int(random.integers(len(measured)))]
    named = [*RESPONSES, None]
    return named[int(random.integers(len(named)))] or Response.gamma(round(random.uniform(*_GAMMAS), 2), 2041)


def _piecewise_linear(random: np.random.Generator) -> Response:
    """Return the response of a camera with one or two knees."""
    knees = np.sort(random.uniform(0.2, 0.85, int(random.integers(1, 3))))
    slopes = np.cumprod([1.0, *(_log_uniform(random, *_STEEPER) for _ in knees)])
    ends = np.array([0.0, *knees, 1.0])
    g = np.concatenate([[0.0], np.cumsum(slopes * np.diff(ends))])
    grey = np.linspace(0.0, 1.0, 2041)
    return Response(np.interp(grey, ends, g / g[-1]), model={"name": "piecewise linear", "knees": knees.tolist()})


def _vignette(random: np.random.Generator) -> tuple[float, float, float]:
    """Return the coefficients of R², R⁴ and R⁶."""
    shares = random.dirichlet((2.0, 0.5, 0.5))
    first, second, third = ((random.uniform(*_CORNERS) - 1) * shares).round(3).tolist()
    return first, second, third


def _exposure_control(random: np.random.Generator, frames: int) -> dict[str, Any]:
    """Return auto exposure for three of four recordings, and programmed exposures for the others."""
    kind = int(random.integers(8))
    if kind == 0:
        factor = round(random.uniform(1.3, 4), 2)
        return {"exposure": "cycle", "exposures_ms": tuple((4.0 * factor ** np.arange(3)).round(4).tolist())}
    if kind == 1:
        half_period = int(random.integers(30, 120))
        triangle = np.abs(np.arange(frames) / half_period % 2 - 1)
        return {"exposure": "file", "exposures_ms": tuple((4.0 * _SWEPT**triangle).round(4).tolist())}
    return {
        "exposure": "auto",
        "auto_gain": float(random.choice([0.25, 0.6])),
        "auto_target": round(random.uniform(0.3, 0.5), 2),
        "gain_max": float(random.choice([1.0, 4.0])),
        "exposure_max_ms": float(random.choice([15.0, 40.0])),
    }
