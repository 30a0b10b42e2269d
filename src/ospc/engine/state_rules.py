"""Rules for the values of a run's state, alone, and in agreement with each other and with the settings.

A checksum detects damage, but not a state that was forged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ospc.correspondence import pixel_statistics
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.keyframe_selection import Kept, KeyframeSelector
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.scene_area import SceneArea
from ospc.correspondence.static_series import StaticSeries
from ospc.correspondence.thumbnail import thumbnail_size
from ospc.engine.state import Epoch, Run
from ospc.estimation.effect_models import AbsorbedLight
from ospc.estimation.effects import Effects
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.prior import PriorHyperparameters
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.monitor import ExposureMonitor
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Baseline, ChangeDetector
from ospc.methods.prediction_errors import PairErrors
from ospc.methods.stationary_camera import StationaryCamera
from ospc.observations import MOMENTS, SURROUND_MOMENTS
from ospc.photometry.geometry import MOST_PIXELS
from ospc.photometry.grey_range import LARGEST_GREY, GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.settings import Settings
from ospc.settings.brightness import MAX_BRIGHTNESS_CHANGES, MAX_REPEATED_FRAMES
from ospc.settings.effects import STEP_EXPOSURES
from ospc.settings.grey_values import COVERAGE_GREY_CELLS, COVERAGE_RADIUS_CELLS, MAX_COUNTED_FRAMES, MAX_GREY_RANGES
from ospc.settings.methods import MAX_BASELINE_PAIRS, MAX_EPOCH_CALIBRATIONS, MAX_FRAME_RATE, MIN_FRAME_RATE
from ospc.settings.response import MAX_KNEES, MOST_RESPONSE_INTERVALS
from ospc.settings.sampling import AGE_CLASSES, MAX_COMPARISONS, MAX_GAIN_POWER
from ospc.settings.vignette import MAX_VIGNETTE_REACH, MIN_USABLE_RADIUS, MOST_RADIAL_TERMS, VIGNETTE_REACH
from ospc.state.numbers import (
    BINS,
    CHANGES,
    COUNT,
    LAG,
    LARGEST,
    MOST,
    UNIT,
    Numbers,
    check_settings,
    count,
    logs,
    require,
    share,
)
from ospc.state.values import has_json_form

SAMPLER_SETTINGS = " ".join(entry.name for entry in fields(FrameSampler) if entry.default is MISSING)

RULES: Mapping[type, Mapping[str, Numbers | None]] = {
    Run: {"max_grey": Numbers(0, LARGEST_GREY)},
    Epoch: {"corrected_lag_frames": LAG},
    ExposureMonitor: {"choice": None, "_known_lag _suspected_lag": LAG},
    FrameSampler: dict.fromkeys(SAMPLER_SETTINGS.split()),
    ExposureTable: {"_log_exposure": logs("frames", unknown=True), "lag_frames": LAG},
    pixel_statistics.PixelStatistics: {
        "_grey_share": share("frames", COVERAGE_GREY_CELLS, most=MAX_COUNTED_FRAMES),
        "_radius_share": share("frames", COVERAGE_RADIUS_CELLS, unknown=True, most=MAX_COUNTED_FRAMES),
        "_log_exposure": logs("frames", most=MAX_COUNTED_FRAMES),
        "_row_alternation": Numbers(-1, 1, ("frames",), most=MAX_COUNTED_FRAMES),
        "_bits": Numbers(0, LARGEST_GREY),
        "_observed": Numbers(0, MOST),
        "_stride": Numbers(1, MOST),
    },
    BrightnessHistory: {
        "last_frame image_since": Numbers(-1, MOST),
        "repeated": count("repeated", most=MAX_REPEATED_FRAMES),
    },
    BrightnessChange: {
        "log_ratio": logs(BINS),
        "weight": Numbers(0, LARGEST, (BINS,)),
        "vignette_terms": Numbers(-3, 3, (BINS, 4)),
        "overlap": UNIT,
        "motion_px": Numbers(0, MOST_PIXELS, unknown=True),
    },
    StationaryCamera: {"motions": Numbers(0, MOST_PIXELS, ("motions",))},
    KeyframeSelector: {"_statistics": Numbers(0, 2 * MAX_COMPARISONS, (4, AGE_CLASSES))},
    Kept: {"log_exposure": logs()},
    Reservoir: {"_halvings": Numbers(0, 64)},
    StaticSeries: {"_stride": Numbers(1, MOST)},
    Fit: {"texture_share": UNIT, "measured_radius": Numbers(0, 3)},
    GreyRange: {"black white": UNIT},
    NoiseModel: {
        "read_variance shot_variance": UNIT,
        "table": Numbers(0, 1, ("levels",)),
        "measured": Numbers(0, 1, (2,)),
        "gain_from_log_exposure": logs(),
        "gain_power": Numbers(0, MAX_GAIN_POWER),
    },
    ResponseBasis: {"intervals": Numbers(1, MOST_RESPONSE_INTERVALS)},
    Effects: {
        "log_typical_exposure": logs(),
        "groups frames": count(2),
        "most_white": Numbers(0, LARGEST, (2,)),
        "step_exposures": Numbers(0, LARGEST, ("steps",), unknown=True, most=STEP_EXPOSURES),
    },
    AbsorbedLight: {
        "frame_moments": Numbers(shape=(MOMENTS,)),
        "white": Numbers(0, 1, (2,)),
        "surround_moments": Numbers(shape=SURROUND_MOMENTS),
    },
    VignetteBasis: {
        "radial": Numbers(0, MOST_RADIAL_TERMS),
        "usable_radius": Numbers(MIN_USABLE_RADIUS, 1),
        "reach": Numbers(VIGNETTE_REACH, MAX_VIGNETTE_REACH),
    },
    ErrorModel: {
        "constant shot read": UNIT,
        "registration_sigma_px radiance_sigma": Numbers(0, 100),
        "factors": Numbers(1e-6, 1e6, ("factors",)),
        "gain_variances": Numbers(0, 100, ("gain variances",)),
    },
    PriorHyperparameters: {
        "walk": Numbers(1e-6, 1e6),
        "drift vignette_walk": Numbers(0, 1e6),
        "knees": Numbers(1, MOST_RESPONSE_INTERVALS - 1, ("knees",), most=MAX_KNEES),
    },
    SceneArea: {"fine": Numbers(shape=("rows", "columns")), "contrast pairs": Numbers(0, shape=("rows", "columns"))},
    Baseline: {
        "errors": Numbers(0, LARGEST, ("errors",), most=MAX_BASELINE_PAIRS),
        "effects": Numbers(0, LARGEST, ("effects",), most=MAX_BASELINE_PAIRS),
        "outliers": count("outliers", 2, most=MAX_BASELINE_PAIRS),
    },
    ChangeDetector: {
        "lag_frames": LAG,
        "first_number complete_before": Numbers(-1, MOST),
        "frames_per_s": Numbers(MIN_FRAME_RATE, MAX_FRAME_RATE),
    },
    PairErrors: {
        "matrix matrix_beyond_light": Numbers(shape=(CHANGES, CHANGES)),
        "vector vector_beyond_light": Numbers(shape=(CHANGES,)),
        "fit_products": Numbers(shape=(CHANGES, "curves")),
        "error": logs(),
        "common": Numbers(shape=(CHANGES,)),
        "max_radius": Numbers(0, 2),
        "grey_limits": share(2),
    },
}
"""Rules for fields of the dataclasses in a state whose types do not say enough, by space-separated names; None if
other checks say it all."""
_BY_TYPE = {int: COUNT, float: Numbers()}
"""Rules for single numbers that have none above."""


def check_fields(value: Any, name: str = "") -> None:
    """Check a dataclass and all dataclasses in it by their rules and types."""
    lengths: dict[str, int] = {}
    rules = {field: rule for names, rule in RULES.get(type(value), {}).items() for field in names.split()}
    for field in (entry.name for entry in fields(value)):
        held, place = getattr(value, field), f"{name}.{field}" if name else field
        rule = rules.get(field, _BY_TYPE.get(type(held)))
        if rule is not None and held is not None:
            rule.check(place, held, lengths)
        for part in filter(is_dataclass, held if isinstance(held, list) else (held,)):
            if not has_json_form(part):
                check_fields(part, place)


def check_run(run: Run, method: object | None, settings: Settings) -> None:
    """Check that a run can continue with these settings; its method checks how the values of its own state agree.

    Raises
    ------
    FormatError
        If a value is out of range, or values are inconsistent.
    """
    check_fields(run)
    require((run.max_grey == 0) == (method is None), "there must be both a first frame and a method, or neither")
    if method is not None:
        check_fields(method)
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
    check_settings("sampler", found, settings.sampler(), SAMPLER_SETTINGS)
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
