"""The fixed set of recordings: a balanced selection instead of every combination of the factors.

Every response is combined with every vignette once. The four recordings of a response have the four combinations of
noise and moving objects, once each. The assignment of vignettes to these combinations changes from response to
response, so that each vignette, too, has both noise levels and both kinds of scene equally often, within one. Every
recording has its own scene, motion and noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ospc.errors import SettingError
from ospc.photometry.response import Response
from ospc.research.accuracy.charts import chart_sources
from ospc.research.accuracy.measured_responses import FILE, read_database
from ospc.research.accuracy.real_video import video_sources
from ospc.research.source import SimulatedSource, Source
from ospc.simulation import SimulationSettings
from ospc.simulation.settings import NoisePreset

FRAMES, STATIC_FRAMES = 500, 150
"""Frames of a simulated recording, with the camera in motion and at rest."""

_SEED = 2024
_NAMED = ("linear", "srgb", "log", "filmic", "tum_narrow")
_VIGNETTES: dict[str, tuple[str, tuple[float, ...]]] = {
    "strong": ("polynomial", (-0.45, 0.05, -0.15)),
    "weak": ("polynomial", (-0.12, 0.0, -0.03)),
    "cos4": ("cos4", ()),
    "decentred": ("decentred", (-0.35, 0.05, -0.15)),
}
_NOISE: tuple[NoisePreset, NoisePreset] = ("low", "high")
_MOVING_OBJECTS = 6
_MEASURED = 8
"""Measured responses: two for each vignette."""

_NOISE_SWAPPED, _SCENES_SWAPPED = (0, 1, 0, 1, 0, 1, 1), (0, 0, 1, 1, 0, 1, 0)
"""For each response, whether the two levels of noise, and of moving objects, are exchanged."""

_Named: TypeAlias = tuple[str, str, str | Response]
"""The name of a response, its level of the factor "response", and the response."""


def accuracy_sources(data: Path | None, frames: int = FRAMES) -> tuple[list[Source], list[str]]:
    """Return all recordings, and notes on what is left out or replaced.

    Parameters
    ----------
    data
        Folder of real data; None for none.
    frames
        Frames of a simulated recording with the camera in motion; one at rest has three tenths of them.

    Raises
    ------
    OspcError
        If a file of the folder does not hold what it should.
    """
    measured, notes = _measured(data)
    (videos, no_videos), (charts, no_charts) = video_sources(data), chart_sources(data)
    sources: list[Source] = [*moving_sources(measured, frames), *static_sources(frames), *videos, *charts]
    return sources, [note for note in (*notes, no_videos, no_charts) if note]


def select(sources: Sequence[Source], pattern: str | None) -> list[Source]:
    """Return the recordings whose name matches a pattern of shell wildcards, or contains one without wildcards.

    Raises
    ------
    SettingError
        If none matches.
    """
    if pattern is None:
        return list(sources)
    wild = pattern if any(c in pattern for c in "*?[") else f"*{pattern}*"
    chosen = [source for source in sources if fnmatchcase(source.name, wild)]
    if not chosen:
        known = ", ".join(source.name for source in sources)
        raise SettingError(f"no recording of the benchmark matches '{pattern}'; known: {known}")
    return chosen


def moving_sources(measured: list[tuple[str, Response]], frames: int) -> list[SimulatedSource]:
    """Return the simulated recordings with the camera in motion.

    Parameters
    ----------
    measured
        Eight named responses, which take the places of two.
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
        _moving_source(place, column, frames, family[column])
        for place, family in enumerate(families)
        for column in range(len(_VIGNETTES))
    ]


def _moving_source(place: int, column: int, frames: int, named: _Named) -> SimulatedSource:
    """Return the recording of the response number ``place`` with the vignette number ``column``."""
    name, family, response = named
    vignette, (model, coefficients) = list(_VIGNETTES.items())[column]
    noise = _NOISE[(column % 2) ^ _NOISE_SWAPPED[place]]
    moving = bool((column // 2) ^ _SCENES_SWAPPED[place])
    scene = "moving" if moving else "still"
    settings = SimulationSettings(
        frames=frames,
        seed=_SEED + len(_VIGNETTES) * place + column,
        response=response,
        vignette=model,
        noise=noise,
        moving_objects=_MOVING_OBJECTS if moving else 0,
    )
    if coefficients:
        settings = replace(settings, vignette_coefficients=coefficients)
    factors = {"response": family, "vignette": vignette, "noise": noise, "scene": scene}
    return SimulatedSource(f"{name}-{vignette}-{noise}-{scene}", settings, factors, with_pairs=True)


def static_sources(frames: int) -> list[SimulatedSource]:
    """Return sweeps of the exposure with the camera at rest."""
    sources: list[SimulatedSource] = []
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
        sources.append(SimulatedSource(f"static-{response}", settings, {"response": response}, True))
    return sources


def _measured(data: Path | None) -> tuple[list[tuple[str, Response]], list[str]]:
    """Return eight responses: measured ones, or gamma curves where no database is given."""
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
