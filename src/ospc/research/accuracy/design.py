"""The accuracy benchmark: a fixed set of recordings, and the methods measured on them.

The simulated recordings are a balanced selection from all combinations of the factors. Every response is combined
with every vignette once. The four recordings of a response cover the four combinations of noise and moving objects.
The assignment of vignettes to these combinations changes between responses, so that each vignette also has both noise
levels and both kinds of scene equally often, within one. Every recording has its own scene, motion and noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, SettingError
from ospc.photometry.response import Response
from ospc.research.accuracy.charts import CHARTS, chart_sources
from ospc.research.accuracy.real_video import VIDEO, VideoSource
from ospc.research.method import VIGNETTE_SOLVERS, Method, OwnMethod, paper_variants
from ospc.research.source import SWEEP, Methods, SimulatedSource, Source
from ospc.settings import PaperSettings, preset
from ospc.simulation import SimulationSettings
from ospc.simulation.responses import LEVELS
from ospc.simulation.settings import NoisePreset

FRAMES, STATIC_FRAMES = 500, 150
"""Frames of a simulated recording with a moving and with a static camera."""
_SEED = 2024
_NAMED = ("linear", "srgb", "log", "filmic", "tum_narrow")
VIGNETTES: dict[str, dict[str, Any]] = {
    "strong": {"vignette": "polynomial", "vignette_coefficients": (-0.45, 0.05, -0.15)},
    "weak": {"vignette": "polynomial", "vignette_coefficients": (-0.12, 0.0, -0.03)},
    "cos4": {"vignette": "cos4"},
    "decentred": {"vignette": "decentred", "vignette_coefficients": (-0.35, 0.05, -0.15)},
}
"""Vignette settings by name."""
_NOISE: tuple[NoisePreset, NoisePreset] = ("low", "high")
_MOVING_OBJECTS = 6
_MEASURED = 8
"""Measured responses: two for each vignette."""
_NOISE_SWAPPED, _SCENES_SWAPPED = (0, 1, 0, 1, 0, 1, 1), (0, 0, 1, 1, 0, 1, 0)
"""For each response, whether the two levels of noise and of moving objects are swapped."""

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class PresetMethods(Methods):
    """The methods of a preset, with its name."""

    def make(self, source: Source) -> dict[str, Method]:
        """Create the methods; "paper" uses every solver if the vignette can be determined."""
        settings = preset(self.name)
        if not isinstance(settings, PaperSettings):
            return {settings.name: OwnMethod(settings.name)}
        if source.group != "simulated":
            return paper_variants({"paper": settings})
        solvers = {f"paper/{solver}": replace(settings, vignette_solver=solver) for solver in VIGNETTE_SOLVERS}
        return paper_variants(solvers)


def accuracy_sources(data: Path | None, frames: int = FRAMES) -> tuple[list[Source], list[str]]:
    """Return all recordings, and notes on what is left out or replaced.

    ``data`` is the folder of real data. Recordings with a moving camera have ``frames`` frames, those with a static
    camera three tenths of that.
    """
    parts = {
        FILE: "gamma curves replace the measured responses",
        VIDEO: "no real video",
        CHARTS: "no photographs of charts",
    }
    places = {} if data is None else {part: data / part for part in parts if (data / part).exists()}
    missing = {part: "--data is not given" if data is None else f"{data / part} does not exist" for part in parts}
    sources: list[Source] = [*moving_sources(places.get(FILE), frames), *_static_sources(frames)]
    if VIDEO in places:
        sources.append(VideoSource(VIDEO, places[VIDEO]))
    if CHARTS in places:
        sources += chart_sources(places[CHARTS])
    return sources, [f"{missing[part]}: {otherwise}" for part, otherwise in parts.items() if part not in places]


def select(items: Mapping[str, _Item], pattern: str | None, what: str = "recording") -> list[_Item]:
    """Return the item with this name, or those whose names match a shell pattern or contain a word."""
    if pattern is None:
        return list(items.values())
    if pattern in items:
        return [items[pattern]]
    wild = pattern if any(c in pattern for c in "*?[") else f"*{pattern}*"
    chosen = [item for name, item in items.items() if fnmatchcase(name, wild)]
    if not chosen:
        raise SettingError(f"no {what} of the benchmark matches '{pattern}'; known: {', '.join(items)}")
    return chosen


def moving_sources(database: Path | None, frames: int) -> Iterator[SimulatedSource]:
    """Yield the simulated recordings with a moving camera; eight measured responses stand in for two."""
    measured = _measured(database)
    # The name of each response, its level of the factor "response", and the response itself.
    kind = measured[0][0].rstrip("0123456789.")
    named: list[tuple[str, str, str | Response]] = [(name, name, name) for name in _NAMED for _ in VIGNETTES]
    named += [(name, kind, response) for name, response in measured]
    for number, (name, family, response) in enumerate(named):
        place, column = divmod(number, len(VIGNETTES))
        vignette = list(VIGNETTES)[column]
        noise = _NOISE[(column % 2) ^ _NOISE_SWAPPED[place]]
        moving = bool((column // 2) ^ _SCENES_SWAPPED[place])
        scene = "moving" if moving else "still"
        settings = SimulationSettings(
            frames=frames,
            seed=_SEED + number,
            response=response,
            noise=noise,
            moving_objects=_MOVING_OBJECTS if moving else 0,
            **VIGNETTES[vignette],
        )
        factors = {"response": family, "vignette": vignette, "noise": noise, "scene": scene}
        yield SimulatedSource(f"{name}-{vignette}-{noise}-{scene}", settings, with_pairs=True, factors=factors)


def _static_sources(frames: int) -> Iterator[SimulatedSource]:
    """Yield exposure sweeps with a static camera."""
    count = max(2, round(frames * STATIC_FRAMES / FRAMES))
    for number, response in enumerate(("srgb", "tum_narrow")):
        settings = replace(SWEEP, frames=count, seed=_SEED + 100 + number, response=response)
        yield SimulatedSource(
            f"static-{response}", settings, with_pairs=True, group="static", factors={"response": response}
        )


def _measured(database: Path | None) -> list[tuple[str, Response]]:
    """Return eight measured responses, or gamma curves if no database is given."""
    random = np.random.default_rng(_SEED)
    if database is None:
        exponents = np.sort(random.uniform(1.2, 3.0, _MEASURED))
        return [(f"gamma{e:.2f}", Response.gamma(float(round(e, 2)), 2041)) for e in exponents]
    curves = read_database(database)
    chosen = np.sort(random.choice(len(curves), _MEASURED, replace=len(curves) < _MEASURED))
    return [(f"measured{number}", curves[number]) for number in chosen]


FILE = "responses/dorf_201.mat"
"""Path of the database in the folder of real data."""
_MAX_VALUES = 5_000_000
"""Most values of an array; a file of some kilobytes may contain any number of equal values."""
_FLATTEST = 1e-6
"""Total slope added to g because a measured curve may be flat; small compared with any noise."""


def read_database(path: Path) -> list[Response]:
    """Read response curves from a MATLAB file with irradiances ``I`` and brightnesses ``B``, one curve per row."""
    from scipy.io import loadmat, whosmat

    try:
        # The sizes are known before anything is unpacked.
        if any(math.prod(shape) > _MAX_VALUES for _, shape, _ in whosmat(path)):
            raise FormatError(f"an array has more than {_MAX_VALUES} values")
        content = loadmat(path, variable_names=["I", "B"])
        curves = zip(content["I"].astype(np.float64), content["B"].astype(np.float64), strict=True)
        return [_response(irradiance, brightness, number) for number, (irradiance, brightness) in enumerate(curves)]
    except Exception as error:  # the reader has no specific error for damaged files
        raise FormatError(f"{path}: not readable as a database of responses ({error}); it needs I and B") from None


def _response(irradiance: FloatArray, brightness: FloatArray, number: int) -> Response:
    """Return g, irradiance as a function of brightness, of the curve with this number."""
    # If the curve is flat at black or white, g starts at the last black irradiance and ends at the first white one.
    low = int(np.flatnonzero(brightness <= brightness[0])[-1])
    high = int(np.flatnonzero(brightness >= brightness[-1])[0])
    rising = np.all(np.isfinite([irradiance, brightness])) and np.all(np.diff(brightness) >= 0)
    if not rising or high <= low or np.any(np.diff(irradiance) <= 0):
        raise FormatError(f"irradiance and brightness of curve {number} do not increase")
    span = brightness[low : high + 1]
    # The tiny ramp keeps equal brightnesses in order for the interpolation.
    grey = (span - span[0]) / (span[-1] - span[0]) + np.arange(len(span)) * 1e-12
    g = np.interp(np.linspace(0, grey[-1], LEVELS), grey, irradiance[low : high + 1])
    return Response.from_values(
        g + np.linspace(0, _FLATTEST, LEVELS), model={"name": "measured", "curve": str(number)}
    )
