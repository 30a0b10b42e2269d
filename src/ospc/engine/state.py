"""The state of a run, and the epochs of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.correspondence.thumbnail import Thumbnail
from ospc.engine.frame_checks import SkippedFrames, why_greys_are_useless
from ospc.engine.verdicts import checked_by_fit, compared_with_epoch_before, judged
from ospc.errors import FrameError
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.monitor import ExposureMonitor
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Change
from ospc.methods.method import Method
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import GreyRange
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.recording.frame import Frame
from ospc.settings.methods import MAX_EPOCH_CALIBRATIONS
from ospc.system.versions import versions

HASHED_FRAMES = 4
"""Number of frames in the hash that identifies a stream."""


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


@dataclass(kw_only=True)
class Run:
    """What is known of a run and its frames so far, except by its method. It is saved in this form.

    Attributes
    ----------
    settings
        The settings, with the name of the preset.
    size, max_grey
        Size in pixels and largest grey value of the frames; (0, 0) and 0 before the first usable one.
    exposures, sampler, pixels
        All exposures, the choice of frames to process, and statistics of the grey values of this epoch.
    epochs
        The epochs that have ended.
    skipped
        The frames that could not be used.
    first_frames
        A hash of the first usable frames, which identifies the stream, and the number of frames in it.
    source
        Identification of the recording; empty for a live camera.
    versions
        Versions of the software that saved it; empty if it was never saved.
    """

    settings: dict[str, Any]
    size: ImageSize = (0, 0)
    max_grey: int = 0
    exposures: ExposureMonitor
    sampler: FrameSampler
    pixels: PixelStatistics = field(default_factory=PixelStatistics)
    epochs: list[Epoch] = field(default_factory=list)
    skipped: SkippedFrames = field(default_factory=SkippedFrames)
    first_frames: tuple[str, int] = ("", 0)
    source: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, Any] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        """Number of frames so far, including skipped ones."""
        return len(self.exposures.table)

    @property
    def all_epochs(self) -> tuple[Epoch, ...]:
        """The epochs that have ended, and the current one."""
        ended = tuple(self.epochs)  # read once: the thread that pushes may replace them at any time
        first = ended[-1].last_frame + 1 if ended else 0
        return (*ended, Epoch(first, self.frames - 1, None, None))

    def skip(self, reason: str) -> None:
        """Skip a frame; ``reason`` is empty if it could have been used."""
        if reason:
            self.skipped = self.skipped.with_another(reason)
        self.sampler.skip()

    def identify_by(self, frame: Frame) -> None:
        """Add the first frames to the hash that identifies this stream."""
        digest, count = self.first_frames
        if count < HASHED_FRAMES:
            content = f"{digest} {frame.stamp_s!r} {frame.exposure_ms!r} ".encode() + frame.image.tobytes()
            self.first_frames = (sha256(content).hexdigest(), count + 1)

    def count_repeated(self, frame: Frame, thumbnail: Thumbnail, first: int) -> None:
        """Count a frame with the image of the ``first`` one, and process the next in its place.

        Raises
        ------
        FrameError
            If it has another exposure.
        """
        self.sampler.expects_repeats = True
        self.exposures.history.observe(thumbnail)
        recorded = self.exposures.table.log_recorded
        if recorded[frame.index] != recorded[first]:
            raise FrameError(f"{frame.name}: repeats the previous image with another exposure, so an image was lost")
        self.sampler.skip()

    def begin_epoch(self, ended: Epoch) -> None:
        """End the current epoch, and begin another with the frame after it."""
        self.epochs = keeping_latest_calibrations([*self.epochs, ended])
        self.exposures.begin_epoch(ended.last_frame + 1)
        self.pixels = self.pixels.of_next_epoch()
        self.sampler.begin_epoch()

    def used_before(self, frame: int, method: Method) -> tuple[ExposureTable, ExposureFindings, GreyRange]:
        """Return what a result of this epoch's frames before another uses: exposures, their findings, grey range."""
        recorded, found = self.exposures.table.before(frame), self.exposures.findings_before(frame)
        grey_range = self.pixels.grey_range_before(frame)
        used = checked_by_fit(method, recorded, found, grey_range, interlaced=self.pixels.interlaced)
        return *used, grey_range

    def judged(self, known: Calibration, found: ExposureFindings, counts: dict[str, int]) -> Calibration:
        """Return a calibration with the counts of its frames and the verdicts that exposures and images allow."""
        cause = self.skipped.why_most_of(self.frames) or why_greys_are_useless(self.pixels.report())
        changes = [epoch.change.text for epoch in self.epochs if epoch.change]
        found = compared_with_epoch_before(found, known, self.epochs[-1].calibration if self.epochs else None)
        result = judged(known, found, cause, changes)
        return replace(result, counts=counts | known.counts, settings=dict(self.settings), versions=versions())
