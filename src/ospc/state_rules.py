"""Checks of the values in a run's state, made when it is loaded and before anything uses it.

A checksum detects damage, but not a state that was forged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ospc.correspondence import noise_estimation, pixel_statistics
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.image_circle import ImageCircle
from ospc.correspondence.keyframe_selection import KeyframeSelectorState
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.correspondence.thumbnail import thumbnail_size
from ospc.engine_state import EngineState, epoch_of
from ospc.errors import FormatError
from ospc.estimation.effect_models import EFFECTS, GAIN_STEPS, AbsorbedLight
from ospc.estimation.effects import Effects
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.prior import PriorHyperparameters
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.exposures.brightness import BrightnessChange, PixelSamples
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.monitor import ExposureMonitorState
from ospc.methods.change_detection import Baseline, ChangeDetector
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.methods.prediction_errors import PairErrors
from ospc.observations import MOMENTS, Observations
from ospc.photometry.geometry import MOST_PIXELS
from ospc.photometry.grey_range import GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.settings import DefaultSettings
from ospc.settings.correspondence import (
    AGE_CLASSES,
    COVERAGE_GREY_CELLS,
    COVERAGE_RADIUS_CELLS,
    MAX_COMPARISONS,
    MAX_COUNTED_FRAMES,
    MAX_GREY_RANGES,
    MIN_NOISE_BLOCKS,
    NOISE_BINS,
    NOISE_FRAMES,
)
from ospc.settings.estimation import FACTOR_GREYS, MIN_USABLE_RADIUS, STEP_EXPOSURES
from ospc.settings.exposures import GREY_BIN_EDGES, MAX_BRIGHTNESS_CHANGES, MAX_REPEATED_FRAMES
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

_CHANGES, _BINS = len(CHANGE_GREY_KNOTS) + 3, len(GREY_BIN_EDGES) - 1
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


def _count(*shape: int | str, most: int = _MOST) -> Numbers:
    return Numbers(0, _MOST, shape, most=most)


def _share(*shape: int | str, unknown: bool = False, most: int = _MOST) -> Numbers:
    return Numbers(0, 1.001, shape, unknown, most)


RULES: Mapping[type, Mapping[str, Numbers | str]] = {
    EngineState: {
        "size epochs reasons first_reasons first_frames": ELSEWHERE,
        "max_grey": Numbers(0, _LARGEST_GREY),
    },
    ExposureMonitorState: {
        "log_exposure": _logs("frames", unknown=True),
        "lag_frames known_lag suspected_lag": LAG,
    },
    pixel_statistics.PixelStatistics: {
        "_histogram _brightest _ranges": ELSEWHERE,
        "_grey_share": _share("frames", COVERAGE_GREY_CELLS, most=MAX_COUNTED_FRAMES),
        "_radius_share": _share("frames", COVERAGE_RADIUS_CELLS, unknown=True, most=MAX_COUNTED_FRAMES),
        "_log_exposure": _logs("frames", most=MAX_COUNTED_FRAMES),
        "_row_alternation": Numbers(-1, 1, ("frames",), most=MAX_COUNTED_FRAMES),
        "_bits": Numbers(0, _LARGEST_GREY),
    },
    BrightnessHistory: {
        "last_frame": Numbers(-1, _MOST),
        "repeated": _count("repeated", most=MAX_REPEATED_FRAMES),
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
        "frames uses": _count("kept"),
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
    NoiseModel: {"read_variance": UNIT, "shot_variance": Numbers(-1, 1), "table": Numbers(0, 1, ("levels",))},
    ResponseBasis: {"intervals": Numbers(1, _MOST_INTERVALS)},
    Effects: {
        "chosen": ELSEWHERE,
        "log_typical_exposure": _logs(),
        "groups": _count(2),
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
        "outliers": _count("outliers", 2, most=MAX_BASELINE_PAIRS),
    },
    ChangeDetector: {
        "lag_frames": LAG,
        "first_number complete_before": Numbers(-1, _MOST),
        "frames_per_s": Numbers(MIN_FRAME_RATE, MAX_FRAME_RATE),
    },
    PairErrors: {
        "matrix": Numbers(shape=(_CHANGES, _CHANGES)),
        "vector": Numbers(shape=(_CHANGES,)),
        "fit_products": Numbers(shape=(_CHANGES, "curves")),
        "error": _logs(),
        "common": Numbers(shape=(_CHANGES,)),
        "max_radius": Numbers(0, 2),
        "grey_limits": _share(2),
    },
}
"""Rules for fields of the dataclasses in a state whose types do not say enough, by space-separated names."""

_BY_TYPE = {int: COUNT, float: Numbers()}
"""Rules for single numbers that have none above."""


def check_run(run: EngineState, method: MaximumLikelihoodState | None, settings: DefaultSettings) -> None:
    """Check that a run and its method can continue with these settings.

    Raises
    ------
    FormatError
        If a value is out of range, or values are inconsistent.
    """
    _check_fields(run)
    frames = len(run.exposures.log_exposure)
    _check_sampler(run.sampler, frames, settings)
    _check_epochs(run, frames)
    _require((run.max_grey == 0) == (method is None), "a run must have both a first frame and a method, or neither")
    if method is None:
        return
    width, height = run.size
    _require(min(run.size) >= 2 and width * height <= MOST_PIXELS, "the size of its frames is impossible")
    _check_pixels(run, frames)
    _check_history(run.exposures.history, frames)
    _check_fields(method)
    _check_method(method, run, settings)


def _check_fields(value: Any, name: str = "") -> None:
    """Check a dataclass and all dataclasses in it by their rules and types."""
    lengths: dict[str, int] = {}
    rules = {field: rule for names, rule in RULES.get(type(value), {}).items() for field in names.split()}
    for field in (entry.name for entry in fields(value)):
        held, place = getattr(value, field), f"{name}.{field}" if name else field
        rule = rules.get(field, _BY_TYPE.get(type(held)))
        if isinstance(rule, Numbers) and held is not None:
            rule.check(place, held, lengths)
        for part in filter(is_dataclass, held if isinstance(held, list) else (held,)):
            _check_fields(part, place)


def _require(holds: Any, otherwise: str) -> None:
    if not holds:
        raise FormatError(otherwise)


def _check_settings(name: str, found: object, new: object, fields: str) -> None:
    for field in fields.split():
        same = getattr(found, field) == getattr(new, field)
        _require(same, f"{name}.{field} differs from its settings")


def _check_sampler(found: FrameSampler, frames: int, settings: DefaultSettings) -> None:
    fixed = "frames_per_slowdown dense_frames longest_pause_frames comparison_period_frames comparison_run_frames"
    _check_settings("sampler", found, settings.sampler(), fixed)
    _require(found.number == frames, "the number of frames is not the number of exposures")
    _require(found.processed <= found.number, "more frames were processed than pushed")
    _require(found._restarted_after <= found.processed, "the sampler restarted in the future")


def _check_epochs(run: EngineState, frames: int) -> None:
    begin = 0
    for epoch in map(epoch_of, run.epochs):
        _require(epoch.first_frame == begin <= epoch.last_frame < frames, "epochs are out of order")
        _require(epoch.change is not None and epoch.calibration is not None, "an epoch ended without a change")
        begin = epoch.last_frame + 1


def _check_pixels(run: EngineState, frames: int) -> None:
    found = run.pixels
    width, height = thumbnail_size(run.size)
    if found._histogram is not None and found._brightest is not None:
        _count(pixel_statistics.level_count(run.max_grey)).check("pixels.histogram", found._histogram)
        _require(found._histogram.any(), "the histogram is empty")
        _share(height, width).check("pixels.brightest", found._brightest)
    _require(
        (found._histogram is None) == (found._brightest is None) == (not found._grey_share), "pixels are missing"
    )
    _require(len(found._ranges) <= MAX_GREY_RANGES, "black and white changed too often")
    numbers = [-1, *(number for number, _, _ in found._ranges), frames]
    _require(all(a < b for a, b in pairwise(numbers)), "changes of black and white are out of order")
    ends = [(found._inherited.black, found._inherited.white), *((low, high) for _, low, high in found._ranges)]
    _require(all(0 <= black < white <= 1 for black, white in ends), "black is not below white")
    _require(
        found._max_grey in (run.max_grey, pixel_statistics.PixelStatistics()._max_grey),
        "pixels have another largest grey value",
    )


def _check_history(found: BrightnessHistory, frames: int) -> None:
    numbers = np.array([change.frame0 for change in found.changes], dtype=np.int64)
    _require(len(numbers) <= MAX_BRIGHTNESS_CHANGES, "there are too many changes of brightness")
    _require(np.all(np.diff(numbers) > 0), "changes of brightness are out of order")
    _require(all(c.frame1 == c.frame0 + 1 < frames for c in found.changes), "frames were compared that do not exist")
    _require(found.last_frame < frames and found.compared <= frames, "frames were observed that do not exist")


def _check_method(method: MaximumLikelihoodState, run: EngineState, settings: DefaultSettings) -> None:
    frames = len(run.exposures.log_exposure)
    kept = method.keyframes.frames
    _require(len(kept) <= settings.keyframes, "there are more keyframes than its settings allow")
    _require(np.all(kept < frames), "keyframes are of frames that do not exist")
    _require(np.all(np.diff(kept) > 0), "keyframes are out of order")
    _check_reservoir(method.reservoir, frames, settings)
    if method.series is not None:
        _check_series(method.series, run, settings)
    _require(method.noise.max_grey == run.max_grey, "its noise has another largest grey value")
    found, waiting = (Numbers(0, 1, ("n",), most=NOISE_FRAMES), Numbers(0, 2, ("n",), most=MIN_NOISE_BLOCKS - 1))
    for ranges, rule in ((method.noise._found, found), (method.noise._waiting, waiting)):
        _require(len(ranges) == NOISE_BINS, "its noise has another number of grey levels")
        for variances in ranges:
            rule.check("noise", variances)
    width, height = settings.preprocessor().small_size(run.size)
    for image in (method.circle.brightest, method.circle.allowed):
        _require(image is None or image.shape == (height, width), "its image circle has another size")
    if method.fit is not None:
        _check_fit(method.fit)
        _require(_is_quick(method.fit), "a quick fit has effects")
    _check_changes(method.changes, frames)


def _check_changes(found: ChangeDetector, frames: int) -> None:
    reference = found.reference
    if reference is not None:
        _check_fit(reference)
        _require(found.complete_before >= 0 or _is_quick(reference), "a reference with effects is a complete fit")
    _require(reference or not (found.pairs or found.seen), "changes are judged without a reference")
    _require(found.grey_range.black < found.grey_range.white, "black is not below white")
    for pair in found.pairs:
        curves = 0 if reference is None else reference.vignette_part.stop
        Numbers(shape=(_CHANGES, curves)).check("changes.pairs.fit_products", pair.fit_products)
        _require(pair.frame0 < pair.frame1 < frames, "changes are of frames that do not exist")
    for seen in found.seen:
        _check_observations("changes.seen", seen, frames)
        _require(len(seen) and seen.in_pairs, "a scene point was not seen in two frames")
    _require(found.since is None or 0 <= found.since < frames, "a suspected change begins in the future")
    _require(found.since is None or found.neighbours.errors, "a suspected change has no evidence")


def _check_reservoir(found: Reservoir, frames: int, settings: DefaultSettings) -> None:
    _require(found.capacity == settings.max_points, "its capacity differs from its settings")
    kept = found.kept
    if kept is None:
        return
    _require(kept.group[0] >= 0 and np.all(np.diff(kept.group) >= 0), "groups are mixed")
    _require(np.all(kept.group == np.repeat(kept.group[kept.starts], kept.counts)), "groups share a point")
    _check_observations("reservoir", kept, frames)


def _check_observations(name: str, found: Observations, frames: int) -> None:
    _require(found.frame.max(initial=0) < frames, "observations are of frames that do not exist")
    Numbers(0, 1, ("n",)).check(f"{name}.grey_variance", found.grey_variance)
    Numbers(0, 10, ("n",)).check(f"{name}.gradient", found.gradient)


def _check_series(found: StaticSeries, run: EngineState, settings: DefaultSettings) -> None:
    new = StaticSeries(points=settings.series_points)
    _check_settings("series", found, new, "pixels points frames")
    if found._places is None:
        _require(not found._grey and not found._index, "the series has no positions")
        return
    width, height = run.size
    _require(found._size == run.size and found._max_grey == run.max_grey, "the series is of different frames")
    Numbers(0, width * height - 1, ("places",), most=new.pixels).check("series.places", found._places)
    one_kind = {grey.dtype for grey in found._grey} in ({np.dtype(np.uint8)}, {np.dtype(np.uint16)})
    _require(one_kind, "the series mixes types of images")
    images = len(found._index)
    Numbers(0, run.max_grey, (images, len(found._places)), most=new.frames).check("series.grey", found._grey)
    Numbers(0, len(run.exposures.log_exposure) - 1, (images,)).check("series.index", found._index)
    _require(np.all(np.diff(found._index) > 0), "the frames of the series are out of order")


def _is_quick(fit: Fit) -> bool:
    """Return whether a fit has neither effects nor gains of frames."""
    return fit.effects == Effects() and not fit.effect_estimates and not fit.errors.gain_variances


def _check_fit(fit: Fit) -> None:
    chosen = fit.effects.chosen
    _require(len(set(chosen)) == len(chosen) and EFFECTS.keys() >= set(chosen), "the fit has unknown effects")
    steps = len(fit.effects.step_exposures)
    _require(steps == STEP_EXPOSURES or not set(chosen) & set(GAIN_STEPS), "the fit has unknown gain steps")
    parameters = fit.vignette_part.stop + len(fit.effects)
    Numbers(-1e6, 1e6, (parameters,)).check("fit.parameters", fit.parameters)
    _require(np.all(fit.response_parameters > 0), "the response of the fit does not increase")
    for name, covariance in (("fit.covariance", fit.covariance), ("fit.chance", fit.chance)):
        Numbers(shape=(parameters, parameters)).check(name, covariance)
        _require(np.all(np.diag(covariance) >= 0), "the fit has negative variances")
    _require(len(fit.errors.factors) in (0, len(FACTOR_GREYS)), "the error model has another number of factors")
