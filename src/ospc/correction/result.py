"""What a corrected recording is, in words and figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray
from ospc.correction.settings import CorrectionSettings
from ospc.formats.opening import Photometry
from ospc.recording import Recording

_WIDE = 4.0
"""Ratio of exposures that costs two of eight bits."""


@dataclass(frozen=True)
class Corrected:
    """What became of a recording.

    Attributes
    ----------
    path
        The folder written.
    formula
        What every pixel holds, as a sentence.
    frames
        Indices of the frames written, shape (n,): also their numbers in times.txt and their file names.
    exposures_ms
        Exposures that the images have now, shape (n,).
    skipped
        Number of frames that could not be read.
    reasons
        Why, for the first of them.
    saturated
        Share of the pixels that were saturated.
    clipped
        Share of the pixels that were not, but are brighter than the output can hold.
    assumed
        Names of the parts of the calibration that are unknown and were taken to be the identity.
    notes
        What a user should know besides.
    """

    path: Path
    formula: str
    frames: tuple[int, ...]
    exposures_ms: FloatArray
    skipped: int
    reasons: tuple[str, ...]
    saturated: float
    clipped: float
    assumed: tuple[str, ...]
    notes: tuple[str, ...]


def formula_of(settings: CorrectionSettings, reference_ms: float | None) -> str:
    """Return what every pixel holds, as a sentence."""
    if reference_ms is None:
        light = "irradiance e·L = g(M)/V"
    elif reference_ms == 1 and settings.limit is None:
        light = "radiance L per ms = g(M)/V / exposure"
    else:
        light = f"irradiance at an exposure of {reference_ms:g} ms = g(M)/V · {reference_ms:g} ms / exposure"
    if settings.limit is None:
        saturated = "; saturated pixels are NaN" if settings.mask_saturated else ""
        return f"{light}, as 32-bit float; 1 saturates the camera where V = 1{saturated}"
    scale = f"{settings.limit}" if settings.white == 1 else f"{settings.limit} / {settings.white:g}"
    saturated = f"; saturated pixels are {settings.limit}" if settings.mask_saturated else ""
    return f"{scale} times the {light}, linear, at most {settings.limit}{saturated}"


def notes_on(recording: Recording, photometry: Photometry, settings: CorrectionSettings) -> Iterator[str]:
    """Give what a user should know before the result is used."""
    calibrated = None if photometry.calibration is None else photometry.calibration.max_grey
    if calibrated not in (None, recording.max_grey):
        yield (
            f"the calibration was made with grey values up to {calibrated}; its response is stretched to those of "
            f"the recording, up to {recording.max_grey}"
        )
    low, high = np.min(recording.exposures_ms), np.max(recording.exposures_ms)
    if settings.output == "grey8" and settings.normalise_exposure and high > _WIDE * low:
        yield (
            f"8 bits hardly hold exposures from {low:.3g} to {high:.3g} ms at one scale; grey16 or irradiance does"
        )
    yield from recording.notes
