"""What an engine knows, as values: the epochs of the camera, and all that a run goes on from."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from ospc.arrays import ImageSize
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.exposures.monitor import ExposureMonitorState
from ospc.methods.change_detection import Change
from ospc.photometry.calibration import Calibration


@dataclass(frozen=True)
class Epoch:
    """A time in which the camera stayed the same: its frames, what was known at its end, and what changed then.

    ``calibration`` and ``change`` are None for the present epoch, whose calibration is the engine's.
    """

    first_frame: int
    last_frame: int
    calibration: Calibration | None
    change: Change | None


@dataclass(frozen=True)
class EngineState:
    """All that an engine knows beside its method.

    ``settings`` has the name of the preset, too. ``size`` and ``max_grey`` are (0, 0) and 0 before there was a frame.
    ``epochs`` are those that ended, as JSON-compatible values. ``reasons`` and ``first_reasons`` say why the latest
    and the first frames could not be used. ``first_frames`` is a hash over the first usable frames, which tells
    streams apart, and how many it covers. ``source`` identifies the recording; it is empty for a live camera.
    """

    settings: dict[str, Any]
    correct_lag: str
    size: ImageSize
    max_grey: int
    exposures: ExposureMonitorState
    sampler: FrameSampler
    pixels: PixelStatistics
    epochs: list[dict[str, Any]]
    skipped: int
    reasons: list[str]
    first_reasons: list[str]
    first_frames: tuple[str, int]
    source: dict[str, Any]
    versions: dict[str, Any]


def epoch_content(epoch: Epoch) -> dict[str, Any]:
    """Return an epoch as JSON-compatible values."""
    content = asdict(replace(epoch, calibration=None))
    return content | {"calibration": None if epoch.calibration is None else epoch.calibration.as_dict()}


def epoch_of(content: dict[str, Any]) -> Epoch:
    """Return the epoch that :func:`epoch_content` made values of."""
    change = None if content["change"] is None else Change(**content["change"])
    calibration = None if content["calibration"] is None else Calibration.from_dict(content["calibration"])
    return Epoch(int(content["first_frame"]), int(content["last_frame"]), calibration, change)
