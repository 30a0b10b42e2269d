"""Rules for single values in a run's state.

A checksum detects damage, but not a state that was forged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from ospc.correspondence import noise_estimation, pixel_statistics
from ospc.correspondence.image_circle import ImageCircle
from ospc.correspondence.keyframe_selection import KeyframeSelectorState
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.engine_state import EngineState
from ospc.errors import FormatError
from ospc.estimation.effect_models import AbsorbedLight
from ospc.estimation.effects import Effects
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.prior import PriorHyperparameters
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.exposures.brightness import BrightnessChange, PixelSamples
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.monitor import ExposureMonitorState
from ospc.frame_checks import SkippedFrames
from ospc.methods.change_detection import Baseline, ChangeDetector
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.methods.prediction_errors import PairErrors
from ospc.observations import MOMENTS
from ospc.photometry.geometry import MOST_PIXELS
from ospc.photometry.grey_range import GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.settings.correspondence import (
    AGE_CLASSES,
    COVERAGE_GREY_CELLS,
    COVERAGE_RADIUS_CELLS,
    MAX_COMPARISONS,
    MAX_COUNTED_FRAMES,
)
from ospc.settings.estimation import MIN_USABLE_RADIUS, STEP_EXPOSURES
from ospc.settings.exposures import GREY_BIN_EDGES, MAX_REPEATED_FRAMES
from ospc.settings.methods import CHANGE_GREY_KNOTS, MAX_BASELINE_PAIRS, MAX_FRAME_RATE, MIN_FRAME_RATE

_MOST = 2**40
"""Largest count: a thousand frames per second for thirty years."""

_LARGEST = 1e12
"""Largest magnitude of any other number: no measurement comes close, and its square is finite."""

_LOG = 50.0
"""Largest magnitude of the logarithm of an exposure in milliseconds or of a ratio."""

_LARGEST_GREY, _LONGEST_LAG_FRAMES, _MOST_INTERVALS, _MOST_RADIAL = 65535, 1000, 256, 32
"""Largest grey value, of 16 bits; largest lag that a command accepts; most terms of response and of vignette, eight
and three times those of any preset."""

CHANGES, _BINS = len(CHANGE_GREY_KNOTS) + 3, len(GREY_BIN_EDGES) - 1
"""Number of parameters of a camera change, and of grey bins of a brightness change."""


@dataclass(frozen=True)
class Numbers:
    """A number, or a list or array of numbers, between two limits; NaN is allowed only if ``unknown``.

    ``shape`` has lengths, or names of lengths that must agree within a dataclass; it is empty for a single number.
    ``most`` is the largest length of the first axis.
    """

    low: float = -_LARGEST
    high: float = _LARGEST
    shape: tuple[int | str, ...] = ()
    unknown: bool = False
    most: int = _MOST

    def check(self, name: str, value: Any, lengths: dict[str, int] | None = None) -> None:
        """Raise a FormatError if a value breaks the rule; add named lengths to ``lengths``."""
        known = {} if lengths is None else lengths
        try:
            array = np.asarray(value)
        except ValueError:
            raise FormatError(f"{name} has rows of different lengths") from None
        if array.size == 0 and array.ndim == 1 and len(self.shape) > 1:
            array = array.reshape(0, *(known.get(n, 0) if isinstance(n, str) else n for n in self.shape[1:]))
        wanted = tuple(
            known.setdefault(n, m) if isinstance(n, str) else n for n, m in zip(self.shape, array.shape, strict=False)
        )
        if array.ndim != len(self.shape) or array.shape != wanted:
            raise FormatError(f"{name} has the shape {array.shape} instead of {self.shape}")
        if array.ndim and len(array) > self.most:
            raise FormatError(f"{name} has {len(array)} entries, more than {self.most}")
        within = (array >= self.low) & (array <= self.high)
        if not np.all(within | np.isnan(array) if self.unknown else within):
            raise FormatError(f"{name} is not between {self.low:g} and {self.high:g}")


ELSEWHERE = "checked by a function below, or only by its declared type"

LAG = Numbers(-_LONGEST_LAG_FRAMES, _LONGEST_LAG_FRAMES)
"""A lag of the exposures, or a change of the lag, in frames."""

COUNT = Numbers(0, _MOST)
"""A count or a frame number."""

UNIT = Numbers(0, 1)
"""A share, or a grey level relative to white."""


def _logs(*shape: int | str, unknown: bool = False, most: int = _MOST) -> Numbers:
    return Numbers(-_LOG, _LOG, shape, unknown, most)


def count(*shape: int | str, most: int = _MOST) -> Numbers:
    """Return the rule for counts or numbers of frames of a shape."""
    return Numbers(0, _MOST, shape, most=most)


def share(*shape: int | str, unknown: bool = False, most: int = _MOST) -> Numbers:
    """Return the rule for shares or relative grey levels of a shape; sums of shares may be rounded."""
    return Numbers(0, 1.001, shape, unknown, most)


RULES: Mapping[type, Mapping[str, Numbers | str]] = {
    EngineState: {
        "size epochs first_frames": ELSEWHERE,
        "max_grey": Numbers(0, _LARGEST_GREY),
    },
    SkippedFrames: {"first latest": ELSEWHERE},
    ExposureMonitorState: {
        "log_exposure": _logs("frames", unknown=True),
        "lag_frames known_lag suspected_lag": LAG,
    },
    pixel_statistics.PixelStatistics: {
        "_histogram _brightest _ranges": ELSEWHERE,
        "_grey_share": share("frames", COVERAGE_GREY_CELLS, most=MAX_COUNTED_FRAMES),
        "_radius_share": share("frames", COVERAGE_RADIUS_CELLS, unknown=True, most=MAX_COUNTED_FRAMES),
        "_log_exposure": _logs("frames", most=MAX_COUNTED_FRAMES),
        "_row_alternation": Numbers(-1, 1, ("frames",), most=MAX_COUNTED_FRAMES),
        "_bits": Numbers(0, _LARGEST_GREY),
    },
    BrightnessHistory: {
        "last_frame": Numbers(-1, _MOST),
        "repeated": count("repeated", most=MAX_REPEATED_FRAMES),
    },
    BrightnessChange: {
        "log_ratio": _logs(_BINS),
        "weight": Numbers(0, _LARGEST, (_BINS,)),
        "vignette_terms": Numbers(-3, 3, (_BINS, 4)),
        "overlap": UNIT,
        "motion_px": Numbers(0, MOST_PIXELS, unknown=True),
    },
    PixelSamples: {
        "log_ratio log_grey": _logs("places"),
        "position0 position1": Numbers(-2, 2, ("places", 2)),
    },
    MaximumLikelihoodState: {"motions": Numbers(0, MOST_PIXELS, ("motions",))},
    KeyframeSelectorState: {
        "frames uses": count("kept"),
        "log_exposure": _logs("kept"),
        "statistics": Numbers(0, 2 * MAX_COMPARISONS, (4, AGE_CLASSES)),
    },
    Reservoir: {"_halvings": Numbers(0, 64)},
    StaticSeries: {"_places _size _grey _index": ELSEWHERE, "_stride": Numbers(1, _MOST)},
    noise_estimation.NoiseEstimator: {"_found _waiting": ELSEWHERE},
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
    },
    ResponseBasis: {"intervals": Numbers(1, _MOST_INTERVALS)},
    Effects: {
        "chosen": ELSEWHERE,
        "log_typical_exposure": _logs(),
        "groups": count(2),
        "step_exposures": Numbers(0, _LARGEST, ("steps",), unknown=True, most=STEP_EXPOSURES),
    },
    AbsorbedLight: {"frame_moments": Numbers(shape=(MOMENTS,)), "surround_moments": Numbers(shape=(1 + MOMENTS,))},
    VignetteBasis: {"radial": Numbers(0, _MOST_RADIAL), "usable_radius": Numbers(MIN_USABLE_RADIUS, 1)},
    ErrorModel: {
        "constant shot read": UNIT,
        "registration_sigma_px radiance_sigma": Numbers(0, 100),
        "factors": Numbers(1e-6, 1e6, ("factors",)),
        "gain_variances": Numbers(0, 100, ("gain variances",)),
    },
    PriorHyperparameters: {"walk": Numbers(1e-6, 1e6), "drift vignette_walk": Numbers(0, 1e6)},
    ImageCircle: {"brightest allowed": ELSEWHERE},
    Baseline: {
        "errors": Numbers(0, _LARGEST, ("errors",), most=MAX_BASELINE_PAIRS),
        "effects": Numbers(0, _LARGEST, ("effects",), most=MAX_BASELINE_PAIRS),
        "outliers": count("outliers", 2, most=MAX_BASELINE_PAIRS),
    },
    ChangeDetector: {
        "lag_frames": LAG,
        "first_number complete_before": Numbers(-1, _MOST),
        "frames_per_s": Numbers(MIN_FRAME_RATE, MAX_FRAME_RATE),
    },
    PairErrors: {
        "matrix": Numbers(shape=(CHANGES, CHANGES)),
        "vector": Numbers(shape=(CHANGES,)),
        "fit_products": Numbers(shape=(CHANGES, "curves")),
        "error": _logs(),
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
            check_fields(part, place)
