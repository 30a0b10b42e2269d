"""Rules for values of a run's state that must agree with each other, with the image size and with the settings."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from ospc.correspondence import pixel_statistics
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.correspondence.thumbnail import thumbnail_size
from ospc.engine_state import EngineState, epoch_of
from ospc.errors import FormatError
from ospc.estimation.effect_models import EFFECTS, GAIN_STEPS
from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.methods.change_detection import ChangeDetector
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.observations import Observations
from ospc.photometry.geometry import MOST_PIXELS
from ospc.settings import DefaultSettings
from ospc.settings.brightness import MAX_BRIGHTNESS_CHANGES
from ospc.settings.effects import STEP_EXPOSURES
from ospc.settings.error_model import FACTOR_GREYS
from ospc.settings.grey_values import MAX_GREY_RANGES
from ospc.settings.sampling import (
    MIN_NOISE_BLOCKS,
    NOISE_BINS,
    NOISE_FRAMES,
)
from ospc.state_rules.fields import CHANGES, Numbers, check_fields, count, share


def check_run(run: EngineState, method: MaximumLikelihoodState | None, settings: DefaultSettings) -> None:
    """Check that a run and its method can continue with these settings.

    Raises
    ------
    FormatError
        If a value is out of range, or values are inconsistent.
    """
    check_fields(run)
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
    check_fields(method)
    _check_method(method, run, settings)


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
        count(pixel_statistics.level_count(run.max_grey)).check("pixels.histogram", found._histogram)
        _require(found._histogram.any(), "the histogram is empty")
        share(height, width).check("pixels.brightest", found._brightest)
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
        Numbers(shape=(CHANGES, curves)).check("changes.pairs.fit_products", pair.fit_products)
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
