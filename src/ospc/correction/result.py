"""Describes a corrected recording in words and figures."""

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
"""Ratio of exposures above which 8-bit output at one scale loses two of its bits."""


@dataclass(frozen=True)
class Corrected:
    """The outcome of a correction.

    Attributes
    ----------
    path
        The folder that was written.
    formula
        The meaning of a pixel value, as a sentence.
    frames
        Indices of the written frames; also their numbers in times.txt and their file names.
    exposures_ms
        Exposures of the corrected images, shape (frames,).
    skipped
        Number of frames that could not be read.
    reasons
        Why, for the first few of them.
    saturated
        Share of the pixels that were saturated.
    clipped
        Share of the other pixels that exceed the range of the output.
    assumed
        Names of the unknown parts of the calibration, which were taken to be the identity.
    notes
        Further remarks for the user.
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
    """Return the meaning of a pixel value, as a sentence."""
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
    """Yield remarks that the user should read before using the result."""
    calibrated = None if photometry.calibration is None else photometry.calibration.max_grey
    if calibrated not in (None, recording.max_grey):
        yield (
            f"the calibration was made with grey values up to {calibrated}; its response is stretched to those of "
            f"the recording, up to {recording.max_grey}"
        )
    low, high = np.min(recording.exposures_ms), np.max(recording.exposures_ms)
    if settings.output == "grey8" and settings.normalise_exposure and high > _WIDE * low:
        yield (
            f"8 bits are too few for exposures from {low:.3g} to {high:.3g} ms at one scale; use grey16 or irradiance"
        )
    yield from recording.notes
