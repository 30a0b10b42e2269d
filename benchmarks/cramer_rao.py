"""Compare the errors of calibrations with the Cramér–Rao bound of their observations.

    python benchmarks/cramer_rao.py --results FOLDER [--frames 300] [--every 4]

Recordings of the accuracy benchmark are simulated twice: unchanged and without noise. The bound is that of the fitted
observations with the noise of the simulated sensor only, and the prior of the fit; the observations count as
independent. Errors beyond the bound come from registration, texture and the model; the error without noise shows how
large these are.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from ospc import OnlineCalibrator
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.fitted import Fitted
from ospc.evaluation.metrics import log_ratio_error, response_shape_rmse, vignette_rmse
from ospc.methods.fit_inputs import FitInputs
from ospc.research.accuracy.design import moving_sources
from ospc.research.source import SimulatedSource
from ospc.simulation import SimulationSettings, frames
from results import Row, errors, measured, table_of

METRICS = ("V", "shape", "kappa")
_COLUMNS = ("recording", *METRICS, *(f"bound {m}" for m in METRICS), *(f"no noise {m}" for m in METRICS))

_DRAWS, _STEP = 40, 0.05
"""Draws from the bound's distribution, and the factor that scales each down so that the metrics change linearly."""

_PIXELS_AVERAGED = 4 * np.pi * 1.5**2
"""Effective number of pixels averaged for a grey level, at the default smoothing of 1.5 pixels."""


def calibrated(settings: SimulationSettings) -> OnlineCalibrator:
    calibrator = OnlineCalibrator()
    for frame in frames(settings):
        calibrator.push(frame)
    return calibrator


def bound(inputs: FitInputs, fit: Fit, settings: SimulationSettings) -> dict[str, float]:
    """Return the RMS of the errors that sensor noise alone would cause."""
    full_well, read_noise = settings.sensor
    variances = np.array([1 / 12 / 255**2, 1 / full_well, (read_noise / full_well) ** 2]) / _PIXELS_AVERAGED
    constant, shot, read = map(float, variances)
    sensor = ErrorModel(constant, shot, read, registration_sigma_px=0.0, radiance_sigma=0.0)
    assert inputs.used is not None
    fitted = Fitted(replace(fit, errors=sensor), inputs.used, inputs.noise)
    equations = fitted.information(fit, fit.parameters)
    precision = equations.matrix + fit.prior(fit.parameters).precision(fit.hyperparameters)
    root = np.linalg.cholesky(np.linalg.inv(precision))
    response, vignette = fit.response(inputs.max_grey), fit.vignette(inputs.size)
    found = []
    for draw in np.random.default_rng(0).standard_normal((_DRAWS, len(root))):
        moved = replace(fit, parameters=fit.parameters + _STEP * root @ draw)
        other, corners = moved.response(inputs.max_grey), vignette_rmse(moved.vignette(inputs.size), vignette)
        found.append((corners, response_shape_rmse(other, response), log_ratio_error(other, response)))
    return dict(zip(METRICS, (np.sqrt(np.mean(np.square(found), axis=0)) / _STEP).tolist(), strict=True))


def row(source: SimulatedSource) -> Row:
    settings = source.settings
    calibrator = calibrated(settings)
    inputs = calibrator.inputs()
    assert inputs is not None
    assert inputs.fit is not None
    without = replace(settings, noise="none")
    return {
        "recording": source.name,
        **errors(calibrator.calibration(), settings),
        **{f"bound {m}": value for m, value in bound(inputs, inputs.fit, settings).items()},
        **errors(calibrated(without).calibration(), without, "no noise "),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, required=True, help="Folder of the results.")
    parser.add_argument("--frames", type=int, default=300, help="Frames of each recording.")
    parser.add_argument("--every", type=int, default=1, help="Use every N-th recording.")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    moving = list(moving_sources(None, arguments.frames))
    calls = {f"{s.name} {arguments.frames}": partial(row, s) for s in moving[:: arguments.every]}
    rows = measured(calls, arguments.results)
    print(table_of("Errors and their bounds", rows, _COLUMNS))
    for metric in METRICS:
        ratios = [r[metric] / r[f"bound {metric}"] for r in rows if r[metric] is not None]
        print(f"{metric}: {np.median(ratios):.2f} times the bound in the median, {max(ratios):.2f} at most")


if __name__ == "__main__":
    main()
