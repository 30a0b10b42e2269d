"""The fixed set of recordings: a balanced choice of what varies, instead of every combination.

Every response meets every vignette once. The four recordings of a response have the four combinations of noise and
moving objects, each once; which vignette meets which combination changes from response to response, so that each
vignette, too, sees both noise levels and both kinds of scene in equal number, give or take one. Every recording has a
scene, a motion and noise of its own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ospc.benchmark.case import Case
from ospc.benchmark.charts import chart_cases
from ospc.benchmark.measured_responses import FILE, read_database
from ospc.benchmark.real_video import video_cases
from ospc.benchmark.simulated import SimulatedCase
from ospc.photometry.response import Response
from ospc.simulation import SimulationSettings
from ospc.simulation.settings import NoisePreset

FRAMES = 500
STATIC_FRAMES = 150
_SEED = 2024
_NAMED = ("linear", "srgb", "log", "filmic", "tum_narrow")
_VIGNETTES: dict[str, tuple[str, tuple[float, ...]]] = {
    "strong": ("polynomial", (-0.45, 0.05, -0.15)),
    "weak": ("polynomial", (-0.12, 0.0, -0.03)),
    "cos4": ("cos4", ()),
    "decentred": ("decentred", (-0.35, 0.05, -0.15)),
}
_NOISE: tuple[NoisePreset, NoisePreset] = ("low", "high")
_MOVERS = 6
_MEASURED = 8
_NOISE_TURN, _MOVERS_TURN = (0, 1, 0, 1, 0, 1, 1), (0, 0, 1, 1, 0, 1, 0)
"""For each response, whether the levels of noise and moving objects trade places."""

_Named: TypeAlias = tuple[str, str, str | Response]
"""What to call a recording's response, the level of the factor that it is, and the response."""


def accuracy_cases(data: Path | None, frames: int = FRAMES) -> tuple[list[Case], list[str]]:
    """Return all cases, and notes on what is left out or replaced.

    Parameters
    ----------
    data
        Folder of real data; None for none.
    frames
        Number of frames of a simulated recording; those of a camera that stands still have three tenths of them.

    Raises
    ------
    OspcError
        If a file of the folder does not hold what it should.
    """
    measured, notes = _measured(data)
    (videos, no_videos), (charts, no_charts) = video_cases(data), chart_cases(data)
    cases: list[Case] = [*moving_cases(measured, frames), *static_cases(frames), *videos, *charts]
    return cases, [note for note in (*notes, no_videos, no_charts) if note]


def moving_cases(measured: list[tuple[str, Response]], frames: int) -> list[SimulatedCase]:
    """Return the simulated recordings of a moving camera.

    Parameters
    ----------
    measured
        Eight responses with names, which fill up two responses' places.
    frames
        Number of frames of each.
    """
    families: list[list[_Named]] = [[(name, name, name)] * len(_VIGNETTES) for name in _NAMED]
    kind = measured[0][0].rstrip("0123456789.")
    families += [
        [(name, kind, response) for name, response in measured[first : first + len(_VIGNETTES)]]
        for first in range(0, len(measured), len(_VIGNETTES))
    ]
    return [
        _moving_case(place, column, frames, family[column])
        for place, family in enumerate(families)
        for column in range(len(_VIGNETTES))
    ]


def _moving_case(place: int, column: int, frames: int, named: _Named) -> SimulatedCase:
    """Return the recording of a response, by its place among them, and a vignette, by its column."""
    name, family, response = named
    vignette, (model, coefficients) = list(_VIGNETTES.items())[column]
    noise = _NOISE[(column % 2) ^ _NOISE_TURN[place]]
    moving = bool((column // 2) ^ _MOVERS_TURN[place])
    scene = "moving" if moving else "still"
    settings = SimulationSettings(
        frames=frames,
        seed=_SEED + len(_VIGNETTES) * place + column,
        response=response,
        vignette=model,
        noise=noise,
        moving_objects=_MOVERS if moving else 0,
    )
    if coefficients:
        settings = replace(settings, vignette_coefficients=coefficients)
    factors = {"response": family, "vignette": vignette, "noise": noise, "scene": scene}
    return SimulatedCase(f"{name}-{vignette}-{noise}-{scene}", settings, factors)


def static_cases(frames: int) -> list[SimulatedCase]:
    """Return sweeps of the exposure by a camera that stands still."""
    cases: list[SimulatedCase] = []
    for number, response in enumerate(("srgb", "tum_narrow")):
        settings = SimulationSettings(
            frames=max(2, round(frames * STATIC_FRAMES / FRAMES)),
            seed=_SEED + 100 + number,
            response=response,
            motion="static",
            exposure="sweep",
            exposure_min_ms=1.0,
            exposure_max_ms=60.0,
        )
        cases.append(SimulatedCase(f"static-{response}", settings, {"response": response}))
    return cases


def _measured(data: Path | None) -> tuple[list[tuple[str, Response]], list[str]]:
    """Return eight responses: measured ones, or gamma curves where there are none."""
    random = np.random.default_rng(_SEED)
    place = None if data is None else data / FILE
    if place is None or not place.is_file():
        where = "--data is not given" if place is None else f"{place} is not there"
        note = f"{where}: gamma curves take the place of measured responses"
        exponents = np.sort(random.uniform(1.2, 3.0, _MEASURED))
        return [(f"gamma{e:.2f}", Response.gamma(float(round(e, 2)), 2041)) for e in exponents], [note]
    curves = read_database(place)
    chosen = np.sort(random.choice(len(curves), _MEASURED, replace=len(curves) < _MEASURED))
    return [(f"measured{number}", curves[number]) for number in chosen], []
