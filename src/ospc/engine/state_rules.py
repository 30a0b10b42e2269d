"""Rules for values of a run that must agree with each other, with the image size and with the settings."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ospc.correspondence import pixel_statistics
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.thumbnail import thumbnail_size
from ospc.engine.state import Run
from ospc.engine.state_fields import check_fields
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.photometry.geometry import MOST_PIXELS
from ospc.settings import Settings
from ospc.settings.brightness import MAX_BRIGHTNESS_CHANGES
from ospc.settings.grey_values import MAX_GREY_RANGES
from ospc.settings.methods import MAX_EPOCH_CALIBRATIONS
from ospc.state.numbers import check_settings, count, require, share


def check_run(run: Run, settings: Settings) -> None:
    """Check that a run can continue with these settings; its method checks its own state.

    Raises
    ------
    FormatError
        If a value is out of range, or values are inconsistent.
    """
    check_fields(run)
    table = run.exposures.table
    frames = len(table)
    require(frames == len(table._log_exposure), "the number of frames is not the number of exposures")
    _check_sampler(run.sampler, frames, settings)
    _check_epochs(run, frames)
    if run.max_grey == 0:
        return
    width, height = run.size
    require(min(run.size) >= 2 and width * height <= MOST_PIXELS, "the size of its frames is impossible")
    _check_pixels(run, frames)
    _check_history(run.exposures.history, frames)


def _check_sampler(found: FrameSampler, frames: int, settings: Settings) -> None:
    fixed = "frames_per_slowdown dense_frames longest_pause_frames comparison_period_frames comparison_run_frames"
    check_settings("sampler", found, settings.sampler(), fixed)
    require(found.number == frames, "the number of frames pushed is not the number of exposures")
    require(found.processed <= found.number, "more frames were processed than pushed")
    require(found._restarted_after <= found.processed, "the sampler restarted in the future")


def _check_epochs(run: Run, frames: int) -> None:
    begin = 0
    for later, epoch in zip(reversed(range(len(run.epochs))), run.epochs, strict=True):
        require(epoch.first_frame == begin <= epoch.last_frame < frames, "epochs are out of order")
        require(epoch.change is not None, "an epoch ended without a change")
        known = epoch.calibration is not None
        require(known == (later < MAX_EPOCH_CALIBRATIONS), "other epochs than the latest have calibrations")
        require(all(0 <= frame < frames for frame in epoch.wrong_exposures), "exposures of frames that do not exist")
        begin = epoch.last_frame + 1
    require(run.exposures._first_frame == begin, "the exposures are of another epoch")


def _check_pixels(run: Run, frames: int) -> None:
    found = run.pixels
    width, height = thumbnail_size(run.size)
    if found._histogram is not None and found._brightest is not None:
        count(pixel_statistics.level_count(run.max_grey)).check("pixels.histogram", found._histogram)
        require(found._histogram.any(), "the histogram is empty")
        share(height, width).check("pixels.brightest", found._brightest)
    require((found._histogram is None) == (found._brightest is None) == (not found._grey_share), "pixels are missing")
    require(len(found._ranges) <= MAX_GREY_RANGES, "black and white changed too often")
    numbers = [-1, *(number for number, _, _ in found._ranges), frames]
    require(all(a < b for a, b in pairwise(numbers)), "changes of black and white are out of order")
    ends = [(found._inherited.black, found._inherited.white), *((low, high) for _, low, high in found._ranges)]
    require(all(0 <= black < white <= 1 for black, white in ends), "black is not below white")
    require(
        found._max_grey in (run.max_grey, pixel_statistics.PixelStatistics()._max_grey),
        "pixels have another largest grey value",
    )


def _check_history(found: BrightnessHistory, frames: int) -> None:
    numbers = np.array([change.frame0 for change in found.changes], dtype=np.int64)
    require(len(numbers) <= MAX_BRIGHTNESS_CHANGES, "there are too many changes of brightness")
    require(np.all(np.diff(numbers) > 0), "changes of brightness are out of order")
    require(all(c.frame1 == c.frame0 + 1 < frames for c in found.changes), "frames were compared that do not exist")
    require(found.last_frame < frames and found.compared <= frames, "frames were observed that do not exist")
    require(found.image_since <= found.last_frame, "the latest image was first seen in the future")
    require(len(found.repeated) <= found.repeats <= found.compared, "repeated frames were not compared")
