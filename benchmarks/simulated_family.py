"""A seeded family of simulated recordings, rendered once and kept on disk."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ospc import Calibration, simulate
from ospc.arrays import FloatArray
from ospc.photometry.response import Response
from ospc.research.method import Estimate
from ospc.research.runner import OnProgress, ResultStore, Task, run
from ospc.research.scoring import Truth, score
from ospc.research.source import SimulatedSource
from ospc.simulation import SimulationSettings, truth
from results import Row

RENDERING_PROCESSES = 2

_RESPONSES: tuple[str | Response, ...] = (
    *("srgb", "gamma2.2", "linear", "filmic", "log", "tum_narrow"),
    *(Response.gamma(exponent, 2041) for exponent in (1.6, 2.8)),
)
_VIGNETTES = ((-0.35, 0.05, -0.15), (-0.12, 0.0, -0.03), (-0.55, 0.1, -0.1), (0.0, -0.25, -0.1))
"""Coefficients of R², R⁴ and R⁶; V at the corner is 0.55, 0.85, 0.45 and 0.65."""

_SHORTEST, _LONGEST = 400, 2000
"""Frames of a recording; their logarithm is drawn evenly from this range."""


def family(count: int, seed: int = 0) -> list[SimulatedSource]:
    """Return the first recordings of a family; a larger count only adds to them."""
    return [_member(number, seed) for number in range(count)]


def _member(number: int, seed: int) -> SimulatedSource:
    random = np.random.default_rng([seed, number])
    response = _RESPONSES[number % len(_RESPONSES)]
    frames = round(float(np.exp(random.uniform(np.log(_SHORTEST), np.log(_LONGEST)))))
    size = ((320, 240), (640, 480))[number % 2 ^ (number // len(_RESPONSES)) % 2]
    settings = SimulationSettings(
        size=size,
        frames=frames,
        seed=1000 * seed + number,
        response=response,
        vignette="polynomial",
        vignette_coefficients=_VIGNETTES[int(random.integers(len(_VIGNETTES)))],
        noise=("low", "high")[int(random.integers(2))],
        motion=("handheld", "handheld", "pan", "forward")[int(random.integers(4))],
        speed=float(np.round(random.uniform(0.6, 1.6), 2)),
        moving_objects=(0, 0, 6)[int(random.integers(3))],
        auto_gain=float(random.choice([0.25, 0.6])),
        auto_target=float(np.round(random.uniform(0.3, 0.5), 2)),
        gain_max=float(random.choice([1.0, 4.0])),
        exposure_max_ms=float(random.choice([15.0, 40.0])),
        **_exposure_course(number, frames, random),
    )
    return SimulatedSource(f"{seed}-{number:03d}", settings)


def _exposure_course(number: int, frames: int, random: np.random.Generator) -> dict[str, object]:
    """Return how the exposure runs: by itself in three recordings of four, otherwise as a program says."""
    if number % 4 != 3:
        return {"exposure": "auto"}
    if number % 8 == 3:
        return {"exposure": "cycle", "exposures_ms": (4.0, 7.0, 12.0, 20.0)}
    period = int(random.integers(60, 240))
    triangle = np.abs(np.arange(frames) % period / (period / 2) - 1)
    return {"exposure": "file", "exposures_ms": tuple((4.0 * 6.0**triangle).round(4).tolist())}


def rendered(members: Sequence[SimulatedSource], folder: Path) -> dict[str, Path]:
    """Render those recordings that the folder doesn't hold yet, and return the path of each by its name."""
    places = {member.name: folder / member.name for member in members}
    tasks = [Task(m.name, m.describe(), partial(_render, m.settings, places[m.name])) for m in members]
    for one in run(tasks, ResultStore(folder / "cache"), RENDERING_PROCESSES):
        if not one.stored:
            print(f"rendered {one.task.name}", flush=True)
    return places


def _render(settings: SimulationSettings, place: Path, _progress: OnProgress) -> bool:
    # What an interruption left behind.
    shutil.rmtree(place, ignore_errors=True)
    simulate(place, settings)
    return True


def relinked(original: Path, place: Path, change: Callable[[FloatArray], FloatArray]) -> Path:
    """Make a recording with the images of another, and other exposures."""
    shutil.copytree(original, place, copy_function=os.link)
    listed = [line.split() for line in (original / "times.txt").read_text().splitlines() if line[:1] != "#"]
    exposures_ms = change(np.array([float(exposure) for *_, exposure in listed])).tolist()
    # The file is linked to the original's, which must not change.
    (place / "times.txt").unlink()
    lines = (f"{name} {stamp} {e}\n" for (name, stamp, _), e in zip(listed, exposures_ms, strict=True))
    (place / "times.txt").write_text("".join(lines))
    return place


def errors(calibration: Calibration | None, known: Any, prefix: str = "") -> Row:
    """Return vignette RMSE, response shape RMSE and κ; None for a part that the calibration lacks.

    ``known`` has the true response and vignette, or is the settings of a simulation.
    """
    true = truth(known) if isinstance(known, SimulationSettings) else known
    estimate = Estimate() if calibration is None else Estimate(calibration.response, calibration.vignette)
    figures = score(estimate, Truth(true.response, true.vignette))
    names = {"V": "vignette_rmse", "shape": "response_shape_rmse", "kappa": "log_ratio_error"}
    return {f"{prefix}{name}": figures.get(figure) for name, figure in names.items()}


def identified(calibration: Calibration | None) -> list[str]:
    verdicts = {} if calibration is None else calibration.verdicts
    return [name for name, verdict in verdicts.items() if verdict.known]
