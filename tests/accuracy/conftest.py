"""Short simulated recordings on disk, each calibrated once as a user would, with their errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from accurate_recordings import RECORDINGS

from ospc import Calibration, calibrate, simulate
from ospc.evaluation.metrics import log_ratio_error, response_shape_rmse, vignette_rmse
from ospc.photometry.response import Response

DARK_GREYS = np.array([40.0, 50.0, 64.0]) / 255
"""Grey levels where noise shifts means the most and the response is known well enough to show it."""


@dataclass(frozen=True)
class Run:
    calibration: Calibration
    errors: dict[str, float]


@pytest.fixture(scope="session")
def run(tmp_path_factory) -> Callable[[str], Run]:
    """Return a function that calibrates the named recording on first use."""

    @cache
    def made(name: str) -> Run:
        recording = simulate(tmp_path_factory.mktemp("accuracy") / name, RECORDINGS[name])
        found = calibrate(recording.path)
        errors = {}
        if found.response is not None:
            errors |= {
                "shape": response_shape_rmse(found.response, recording.response),
                "kappa": log_ratio_error(found.response, recording.response),
                "dark": dark_error(found.response, recording.response),
            }
        if found.vignette is not None:
            errors |= {"vignette": vignette_rmse(found.vignette, recording.vignette)}
        return Run(found, errors)

    return made


def dark_error(estimate: Response, truth: Response) -> float:
    """Return the root mean square error of ln g at dark grey levels, relative to g at the middle."""
    curves = [np.log(response.inverse(DARK_GREYS) / response.inverse(0.5)) for response in (estimate, truth)]
    return float(np.sqrt(np.mean((curves[0] - curves[1]) ** 2)))
