"""The results of checking a recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.correspondence.pixel_statistics import PixelReport
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.brightness_report import BrightnessReport
from ospc.exposures.findings import ExposureFindings
from ospc.methods.fit_inputs import FitInputs
from ospc.photometry.verdict import Verdict
from ospc.settings.brightness import GREY_BIN_EDGES
from ospc.settings.diagnosis import GAP_RATIO

_MOST_DROPPED = 1e9
"""Most dropped frames counted: stamps from two clocks may be decades apart, and the count must fit an integer."""


@dataclass(frozen=True)
class Timing:
    """Time stamps and repeated images.

    ``interval_s`` is the median time between frames, NaN for a single frame. ``gaps`` is the number of intervals
    longer than 1.5 times the median, and ``dropped_frames`` the number of frames that would fill them.
    Of ``compared_frames`` compared frames, ``duplicates`` are identical to the previous one; ``duplicate_frames`` are
    the indices of the first of them.
    """

    interval_s: float
    gaps: int
    dropped_frames: int
    duplicates: int
    duplicate_frames: tuple[int, ...]
    compared_frames: int


def timing(stamps_s: FloatArray, compared: BrightnessHistory) -> Timing:
    """Summarise time stamps in seconds, shape (frames,), and the comparisons of consecutive frames."""
    interval = np.diff(stamps_s)
    usual = float(np.median(interval)) if len(interval) else float("nan")
    missing = np.rint(interval[interval > GAP_RATIO * usual] / usual) - 1 if usual > 0 else np.empty(0)
    return Timing(
        interval_s=usual,
        gaps=len(missing),
        dropped_frames=int(min(missing.sum(), _MOST_DROPPED)),
        duplicates=compared.repeats,
        duplicate_frames=tuple(compared.repeated),
        compared_frames=compared.compared,
    )


@dataclass(frozen=True)
class MotionReport:
    """Motion of the scene in the image.

    Attributes
    ----------
    median_px_per_frame
        Median displacement between consecutive frames in pixels; NaN if nothing could be tracked.
    radial_motion
        Radial displacement, in half diagonals, of the scene points that determine the vignette; 0 if the camera is
        stationary.
    found_share
        Share of the image that is well exposed and visible in the next frame; NaN if no frames were compared.
    stationary
        Whether the camera is stationary.
    """

    median_px_per_frame: float
    radial_motion: float
    found_share: float
    stationary: bool


def motion(changes: Sequence[BrightnessChange], inputs: FitInputs | None) -> MotionReport:
    """Summarise the motion between consecutive frames and of the scene points over the run."""
    displacement = [c.motion_px for c in changes if np.isfinite(c.motion_px)]
    return MotionReport(
        float(np.median(displacement)) if displacement else float("nan"),
        0.0 if inputs is None else inputs.radial_motion,
        float(np.median([c.overlap for c in changes])) if changes else float("nan"),
        inputs is not None and inputs.stationary,
    )


SCHEMA = "ospc-check/1"

_MOST_LISTED = 100
"""Most jumps and repeated frames listed, to keep the report small if a recording is full of them."""


@dataclass(frozen=True)
class RecordingReport:
    """What a recording can determine about its camera, and what is wrong with it.

    Attributes
    ----------
    name, kind, frames, size, max_grey
        Name and kind of the recording, number of frames, width and height in pixels, largest grey value.
    processed, unreadable
        Number of frames processed, and number of frames that could not be used.
    exposures
        What the images show about the exposures.
    pixels
        Coverage of grey levels and radii, clipping, surround.
    timing
        Frame rate, dropped and repeated frames.
    motion
        Motion of the scene in the image.
    verdicts
        For ``"response"``, ``"vignette"`` and ``"exposures"``: whether it is identifiable, why, and what to record
        instead.
    complete
        Whether a calibration of these frames is complete: all verdicts are identifiable, and there are no warnings.
    warnings
        The warnings of a calibration of these frames.
    notes
        Everything else a user should know, worst first, beginning with the warnings.
    """

    name: str
    kind: str
    frames: int
    size: ImageSize
    max_grey: int
    processed: int
    unreadable: int
    exposures: ExposureFindings
    pixels: PixelReport
    timing: Timing
    motion: MotionReport
    verdicts: dict[str, Verdict]
    complete: bool
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def exposure_lag_frames(self) -> int | None:
        """Number of frames by which the exposures lag; None if it cannot be determined."""
        return self.exposures.lag.frames

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON-compatible values; unknown values are None."""
        return {
            "schema": SCHEMA,
            "recording": {
                "name": self.name,
                "kind": self.kind,
                "frames": self.frames,
                "width_px": self.size[0],
                "height_px": self.size[1],
                "max_grey": self.max_grey,
                "frames_processed": self.processed,
                "frames_unreadable": self.unreadable,
            },
            "exposure_lag_frames": self.exposure_lag_frames,
            "exposure_lag_corrected_frames": self.exposures.corrected_frames,
            "warnings": list(self.warnings),
            "verdicts": {name: verdict.state for name, verdict in self.verdicts.items()},
            "reasons": {name: verdict.reason for name, verdict in self.verdicts.items()},
            "remedies": {name: verdict.remedy or None for name, verdict in self.verdicts.items()},
            **_exposure_figures(self.exposures, self.timing.interval_s),
            "grey_levels": _grey_levels(self.pixels),
            "radii": {
                "exposed_share_by_radius": [_known(value) for value in self.pixels.mean_radius_share],
                "radial_motion_half_diagonals": self.motion.radial_motion,
                "motion_px_per_frame": _known(self.motion.median_px_per_frame),
                "found_again_share": _known(self.motion.found_share),
                "camera_stationary": self.motion.stationary,
            },
            "timing": _timing(self.timing),
            "notes": list(self.notes),
        }


def _known(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _exposure_figures(found: ExposureFindings, interval_s: float) -> dict[str, Any]:
    recorded, lag = found.evidence.recorded, found.lag
    return {
        "exposure": {
            "lowest_ms": recorded.lowest_ms,
            "highest_ms": recorded.highest_ms,
            "highest_over_lowest_ratio": recorded.ratio,
            "different_exposures": recorded.values,
            "changed_frames_share": recorded.changed_share,
            "cycle_frames": recorded.cycle_frames,
        },
        "lag": {
            "state": lag.state,
            "candidates_frames": list(lag.candidates),
            "tried_frames": lag.lags.tolist(),
            "log_likelihood_difference": lag.score.tolist(),
            "lead_sigmas": lag.sigmas.tolist(),
            "best_fraction_frames": lag.fraction_frames,
            "compared_pairs": lag.pairs,
            "log_grey_per_log_exposure": None
            if lag.fit is None or not lag.fit.slopes.any()
            else lag.fit.slopes.tolist(),
            "full_scale_share_edges_of_these": GREY_BIN_EDGES.tolist(),
        },
        "brightness": None if found.brightness is None else _brightness(found.brightness, interval_s),
    }


def _brightness(found: BrightnessReport, interval_s: float) -> dict[str, Any]:
    return {
        "change_rms_log": found.change_rms_log,
        "unexplained_rms_log": found.unexplained_rms_log,
        "unexplained_share": _known(found.unexplained_share),
        "drift_at_constant_exposure_log": found.drift_at_constant_exposure_log,
        "stale_metadata": found.stale,
        "unexplained_jumps": [
            {"frame": jump.frame, "brightness_change_log": jump.log_change} for jump in found.jumps[:_MOST_LISTED]
        ],
        "flicker": [
            {
                "cycles_per_frame": f.cycles_per_frame,
                "seen_frequency_hz": _known(f.cycles_per_frame / interval_s) if interval_s else None,
                "grey_amplitude_log": f.brightness_amplitude,
                "share": f.share,
            }
            for f in found.flicker
        ],
    }


def _grey_levels(pixels: PixelReport) -> dict[str, Any]:
    return {
        "covered_share": float(pixels.covered_grey.mean()),
        "pixel_share_by_grey": pixels.grey_share.mean(axis=0).tolist(),
        "saturated_share": pixels.saturated_share,
        "black_share": pixels.black_share,
        "lowest_grey": pixels.lowest_grey,
        "highest_grey": pixels.highest_grey,
        "empty_low_bits": pixels.empty_low_bits,
        "missing_levels_share": pixels.missing_levels_share,
        "black_surround": pixels.surround,
        "black_surround_share": pixels.surround_share,
    }


def _timing(timing: Timing) -> dict[str, Any]:
    interval_s = _known(timing.interval_s)
    return {
        "median_interval_s": interval_s,
        "frames_per_s": 1 / interval_s if interval_s else None,
        "gaps": timing.gaps,
        "dropped_frames": timing.dropped_frames,
        "duplicate_frames": timing.duplicates,
        "duplicate_frame_indices": list(timing.duplicate_frames[:_MOST_LISTED]),
        "frames_compared_with_previous": timing.compared_frames,
    }
