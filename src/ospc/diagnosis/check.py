"""Check a recording: run the engine and report everything that could spoil a calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from ospc.calibrator import OnlineCalibrator, drive
from ospc.correspondence.pixel_statistics import PixelReport
from ospc.diagnosis.report import RecordingReport, Timing, motion, timing
from ospc.engine.frame_checks import clipped_in_words, skipped_in_words
from ospc.errors import RecordingError, SettingError, counted
from ospc.exposures.brightness_report import BrightnessReport
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.lag_choice import LagChoice
from ospc.recording import Recording, open_recording
from ospc.settings.diagnosis import DARK_CORNER_SHARE, MANY_CLIPPED_SHARE, SLOWEST_VIDEO_S, WEAK_SLOPE
from ospc.settings.lag import MAX_LAG


def check_recording(
    recording: Recording | str | Path,
    *,
    frames: int | None = None,
    correct_lag: LagChoice = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> RecordingReport:
    """Report what a calibration of a recording would find, and what is wrong with the recording.

    The frames go through the same engine as a calibration. The verdicts, and ``correct_lag``, are those of
    :func:`~ospc.calibrator.calibrate`.

    Parameters
    ----------
    recording
        A recording, or its path.
    frames
        Number of frames to use, from the beginning; None for all.
    progress
        Called after every frame with the number of frames processed and the total.

    Raises
    ------
    RecordingError
        If the recording cannot be opened, or none of the frames can be used.
    SettingError
        If ``frames`` is less than 1, or ``correct_lag`` is invalid.
    """
    if frames is not None and frames < 1:
        raise SettingError(f"frames is {frames}; give at least 1, or None for all")
    if isinstance(recording, str | Path):
        recording = open_recording(recording)
    total = min(frames or len(recording), len(recording))
    calibrator = OnlineCalibrator.of(recording, correct_lag=correct_lag, source={})  # nothing is saved
    shown = None if progress is None else lambda _frame, _used: progress(calibrator.frames, total)
    drive(calibrator, islice(recording, total), shown)
    brightness, pixels = calibrator.brightness, calibrator.pixels.report()
    if pixels is None:
        why = calibrator.first_reasons[0] if calibrator.first_reasons else "there are none"
        raise RecordingError(f"{recording.path}: none of its frames can be used; the first: {why}")
    found, calibration = calibrator.exposure_findings(), calibrator.calibration()
    when = timing(recording.stamps_s[:total], brightness)
    remarks = (
        *_about_frames(when, calibration.counts, calibrator.first_reasons),
        *_about_lag(found),
        *_about_brightness(found.brightness, when),
        *_about_pixels(pixels),
    )
    return RecordingReport(
        name=recording.path.name or recording.path.resolve().name,
        kind=recording.kind,
        frames=len(recording),
        size=recording.size,
        max_grey=recording.max_grey,
        processed=calibrator.processed,
        unreadable=calibration.counts["skipped"],
        exposures=found,
        pixels=pixels,
        timing=when,
        motion=motion(brightness.changes, calibrator.inputs()),
        verdicts=calibration.verdicts,
        complete=calibration.complete,
        warnings=calibration.warnings,
        notes=(*calibration.warnings, *calibration.notes, *remarks, *recording.notes),
    )


def _about_frames(timing: Timing, counts: Mapping[str, int], reasons: Sequence[str]) -> Iterator[str]:
    if counts["skipped"]:
        yield skipped_in_words(counts["skipped"], counts["frames"], reasons)
    if timing.duplicates:
        yield (
            f"{timing.duplicates} of {timing.compared_frames} frames repeat the previous image, first at "
            f"frame {timing.duplicate_frames[0]}: dropped frames were replaced by copies, and exposures may belong "
            "to other frames; record without such copies"
        )
    if timing.dropped_frames and timing.interval_s < SLOWEST_VIDEO_S:
        yield (
            f"{counted(timing.dropped_frames, 'frame')} missing in {counted(timing.gaps, 'gap')} between time "
            f"stamps, at {1 / timing.interval_s:.3g} frames a second"
        )


def _about_lag(found: ExposureFindings) -> Iterator[str]:
    lag, cycle = found.lag, found.evidence.recorded.cycle_frames
    if lag.frames is not None and cycle is not None and cycle <= 2 * MAX_LAG:
        yield (
            f"the exposures repeat every {cycle} frames, so a lag of {lag.frames} cannot be distinguished from "
            f"{lag.frames - cycle} or {lag.frames + cycle}, which are less likely"
        )
    if lag.fit is not None and lag.fit.slopes.any() and float(np.median(lag.fit.slopes)) < WEAK_SLOPE:
        yield (
            "brightness follows the exposure only weakly; automatic gain or tone mapping may counteract it: switch "
            "them off"
        )


def _about_brightness(brightness: BrightnessReport | None, timing: Timing) -> Iterator[str]:
    if brightness is None:
        return
    if (largest := brightness.largest_jump) is not None:
        count = len(brightness.jumps)
        also = "" if count == 1 else f", the largest of {count} jumps"
        yield (
            f"{largest.in_words}{also}: a gain or an aperture changed that the metadata do not record, a lamp was "
            "switched, or the recorded exposure changed without an effect"
        )
    for flicker in brightness.flicker:
        often = f"every {1 / flicker.cycles_per_frame:.2g} frames"
        if np.isfinite(timing.interval_s) and timing.interval_s > 0:
            often += f" ({flicker.cycles_per_frame / timing.interval_s:.3g} Hz as sampled)"
        yield (
            f"brightness flickers by ±{flicker.brightness_amplitude:.1%} {often}, which the exposures do not "
            "explain; use daylight, or exposures that are multiples of the lamp's period (10 ms at 50 Hz)"
        )


def _about_pixels(pixels: PixelReport) -> Iterator[str]:
    yield from clipped_in_words(pixels, MANY_CLIPPED_SHARE)
    if pixels.surround == "disc":
        yield (
            f"the image is a disc surrounded by black ({pixels.surround_share:.0%} of the image), as with a fisheye "
            "lens; the surround is not used"
        )
    if pixels.surround == "border":
        yield f"the border of the image ({pixels.surround_share:.1%} of it) is always black, and not used"
    if pixels.empty_low_bits:
        yield (
            f"all grey values are multiples of {2**pixels.empty_low_bits}, with "
            f"{counted(pixels.empty_low_bits, 'unused low bit')}"
        )
    elif pixels.missing_levels_share:
        yield (
            f"{pixels.missing_levels_share:.0%} of the grey values between lowest and highest never occur: the "
            "contrast was stretched after recording, or the values have fewer bits than they are stored with"
        )
    corner = pixels.mean_radius_share[-1]
    if pixels.surround == "none" and np.isfinite(corner) and corner < DARK_CORNER_SHARE:
        yield "the corners are rarely well exposed; the vignette there would be extrapolated"
