"""Rules for single values in a run's state.

A checksum detects damage, but not a state that was forged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from ospc.correspondence import noise_estimation, pixel_statistics
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.keyframe_selection import Kept, KeyframeSelector
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.scene_area import SceneArea
from ospc.correspondence.static_series import StaticSeries
from ospc.engine.frame_checks import SkippedFrames
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
from ospc.methods.epoch_data import EpochData
from ospc.methods.prediction_errors import PairErrors
from ospc.methods.stationary_camera import StationaryCamera
from ospc.observations import MOMENTS
from ospc.photometry.geometry import MOST_PIXELS
from ospc.photometry.grey_range import LARGEST_GREY, GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.settings.brightness import MAX_REPEATED_FRAMES
from ospc.settings.effects import STEP_EXPOSURES
from ospc.settings.grey_values import COVERAGE_GREY_CELLS, COVERAGE_RADIUS_CELLS, MAX_COUNTED_FRAMES
from ospc.settings.methods import MAX_BASELINE_PAIRS, MAX_FRAME_RATE, MIN_FRAME_RATE
from ospc.settings.sampling import AGE_CLASSES, MAX_COMPARISONS, MAX_GAIN_POWER
from ospc.settings.vignette import MAX_VIGNETTE_REACH, MIN_USABLE_RADIUS, VIGNETTE_REACH
from ospc.state.numbers import (
    BINS,
    CHANGES,
    COUNT,
    LAG,
    LARGEST,
    MOST,
    MOST_INTERVALS,
    MOST_RADIAL,
    UNIT,
    Numbers,
    count,
    logs,
    share,
)
from ospc.state.values import has_json_form

ELSEWHERE = "checked with the other values that it has to agree with, or only by its declared type"

RULES: Mapping[type, Mapping[str, Numbers | str]] = {
    Run: {
        "size epochs first_frames": ELSEWHERE,
        "max_grey": Numbers(0, LARGEST_GREY),
    },
    Epoch: {"calibration wrong_exposures": ELSEWHERE, "corrected_lag_frames": LAG},
    SkippedFrames: {"first latest": ELSEWHERE},
    FrameSampler: {
        "frames_per_slowdown dense_frames longest_pause_frames comparison_period_frames comparison_run_frames": (
            ELSEWHERE
        ),
    },
    ExposureMonitor: {"choice": ELSEWHERE, "_known_lag _suspected_lag": LAG},
    ExposureTable: {"_log_exposure": logs("frames", unknown=True), "lag_frames": LAG},
    pixel_statistics.PixelStatistics: {
        "_histogram _brightest _ranges": ELSEWHERE,
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
    EpochData: {"size": ELSEWHERE},
    StationaryCamera: {"motions": Numbers(0, MOST_PIXELS, ("motions",))},
    KeyframeSelector: {"_kept": ELSEWHERE, "_statistics": Numbers(0, 2 * MAX_COMPARISONS, (4, AGE_CLASSES))},
    Kept: {"log_exposure": logs()},
    Reservoir: {"_halvings": Numbers(0, 64)},
    StaticSeries: {"_places _size _grey _index": ELSEWHERE, "_stride": Numbers(1, MOST)},
    noise_estimation.NoiseEstimator: {"_found _frames _waiting": ELSEWHERE},
    Fit: {
        "effect_estimates parameters covariance chance": ELSEWHERE,
        "texture_share": UNIT,
        "measured_radius": Numbers(0, 3),
    },
    GreyRange: {"black white": UNIT},
    NoiseModel: {
        "read_variance": UNIT,
        "shot_variance": Numbers(-1, 1),
        "table": Numbers(0, 1, ("levels",)),
        "measured": Numbers(0, 1, (2,)),
        "gain_from_log_exposure": logs(),
        "gain_power": Numbers(0, MAX_GAIN_POWER),
    },
    ResponseBasis: {"intervals": Numbers(1, MOST_INTERVALS)},
    Effects: {
        "chosen": ELSEWHERE,
        "log_typical_exposure": logs(),
        "groups": count(2),
        "step_exposures": Numbers(0, LARGEST, ("steps",), unknown=True, most=STEP_EXPOSURES),
    },
    AbsorbedLight: {"frame_moments": Numbers(shape=(MOMENTS,)), "surround_moments": Numbers(shape=(1 + MOMENTS,))},
    VignetteBasis: {
        "radial": Numbers(0, MOST_RADIAL),
        "usable_radius": Numbers(MIN_USABLE_RADIUS, 1),
        "reach": Numbers(VIGNETTE_REACH, MAX_VIGNETTE_REACH),
    },
    ErrorModel: {
        "constant shot read": UNIT,
        "registration_sigma_px radiance_sigma": Numbers(0, 100),
        "factors": Numbers(1e-6, 1e6, ("factors",)),
        "gain_variances": Numbers(0, 100, ("gain variances",)),
    },
    PriorHyperparameters: {"walk": Numbers(1e-6, 1e6), "drift vignette_walk": Numbers(0, 1e6)},
    SceneArea: {
        "brightest allowed": ELSEWHERE,
        "fine": Numbers(shape=("rows", "columns")),
        "contrast pairs": Numbers(0, shape=("rows", "columns")),
    },
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
        "matrix": Numbers(shape=(CHANGES, CHANGES)),
        "vector": Numbers(shape=(CHANGES,)),
        "fit_products": Numbers(shape=(CHANGES, "curves")),
        "error": logs(),
        "common": Numbers(shape=(CHANGES,)),
        "max_radius": Numbers(0, 2),
        "grey_limits": share(2),
    },
}
"""Rules for fields of the dataclasses in a state whose types do not say enough, by space-separated names."""
_BY_TYPE = {int: COUNT, float: Numbers()}
"""Rules for single numbers that have none above."""


def check_fields(value: Any, name: str = "") -> None:
    """Check a dataclass and all dataclasses in it by their rules and types."""
    lengths: dict[str, int] = {}
    rules = {field: rule for names, rule in RULES.get(type(value), {}).items() for field in names.split()}
    for field in (entry.name for entry in fields(value)):
        held, place = getattr(value, field), f"{name}.{field}" if name else field
        rule = rules.get(field, _BY_TYPE.get(type(held)))
        if isinstance(rule, Numbers) and held is not None:
            rule.check(place, held, lengths)
        for part in filter(is_dataclass, held if isinstance(held, list) else (held,)):
            if not has_json_form(part):
                check_fields(part, place)
