"""The state of an engine as plain values, with the epochs of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.engine.frame_checks import SkippedFrames
from ospc.exposures.monitor import ExposureMonitor
from ospc.methods.change_detection import Change
from ospc.photometry.calibration import Calibration
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.settings.methods import MAX_EPOCH_CALIBRATIONS


@dataclass(frozen=True)
class Epoch:
    """A range of frames in which the camera did not change.

    Attributes
    ----------
    first_frame, last_frame
        Numbers of its first and its last frame.
    calibration
        The calibration from its frames; None for the current epoch, whose calibration is that of the engine, and for
        all but the last eight that have ended.
    change
        The change that ended it; None for the current epoch.
    corrected_lag_frames, wrong_exposures
        Number of frames by which exposures were recorded late and that was corrected, and the frames whose exposures
        were ignored. Both are 0 and empty for the current epoch.
    """

    first_frame: int
    last_frame: int
    calibration: Calibration | None
    change: Change | None
    corrected_lag_frames: int = 0
    wrong_exposures: tuple[int, ...] = ()


def keeping_latest_calibrations(ended: Sequence[Epoch]) -> list[Epoch]:
    """Return the epochs that have ended, without the calibrations of all but the last few."""
    older, latest = ended[:-MAX_EPOCH_CALIBRATIONS], ended[-MAX_EPOCH_CALIBRATIONS:]
    return [*(replace(epoch, calibration=None) for epoch in older), *latest]


def response_before_change(epochs: Sequence[Epoch], log_exposure: FloatArray) -> PriorCalibration | None:
    """Return the response known before the latest change if only the vignette changed; otherwise None.

    Parameters
    ----------
    epochs
        The epochs that have ended.
    log_exposure
        ln of the exposures in milliseconds of all frames so far, shape (frames,).
    """
    ended = epochs[-1] if epochs else None
    if ended is None or ended.change is None or ended.change.part != "vignette":
        return None
    if ended.calibration is None or ended.calibration.response is None:
        return None
    own = log_exposure[ended.first_frame : ended.last_frame + 1]
    range_ms = np.exp([np.nanmin(own), np.nanmax(own)]).tolist()
    before = replace(ended.calibration, vignette=None, source={"exposure_range_ms": range_ms})
    return PriorCalibration.of(before, f"frames {ended.first_frame} to {ended.last_frame}")


@dataclass(frozen=True)
class EngineState:
    """State of an engine, except for its method.

    ``settings`` includes the name of the preset. ``size`` and ``max_grey`` are (0, 0) and 0 before the first frame.
    ``epochs`` has the epochs that have ended. ``first_frames`` is a hash of the first usable frames, which identifies
    the stream, and the number of frames in it. ``source`` identifies the recording, if it is not a live camera.
    """

    settings: dict[str, Any]
    size: ImageSize
    max_grey: int
    exposures: ExposureMonitor
    sampler: FrameSampler
    pixels: PixelStatistics
    epochs: list[Epoch]
    skipped: SkippedFrames
    first_frames: tuple[str, int]
    source: dict[str, Any]
    versions: dict[str, Any]
