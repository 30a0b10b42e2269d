"""The state from which the default method continues a run, and rules for values of it that must agree."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ospc.arrays import ImageSize
from ospc.correspondence.keyframe_selection import KeyframeSelector
from ospc.correspondence.noise_estimation import NoiseEstimator
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.estimation.effect_models import EFFECTS, GAIN_STEPS
from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.methods.change_detection import ChangeDetector
from ospc.methods.epoch_data import EpochData
from ospc.observations import Observations
from ospc.settings import DefaultSettings
from ospc.settings.effects import STEP_EXPOSURES
from ospc.settings.error_model import FACTOR_GREYS
from ospc.settings.sampling import MIN_NOISE_BLOCKS, NOISE_BINS, NOISE_FRAMES
from ospc.state.numbers import CHANGES, Numbers, check_settings, require


@dataclass(frozen=True)
class MaximumLikelihoodState:
    """The state of :class:`~ospc.methods.maximum_likelihood.MaximumLikelihoodMethod`."""

    keyframes: KeyframeSelector
    """Keyframes by their numbers; their images are read again."""
    data: EpochData
    """What is kept of the frames of the current epoch."""
    fit: Fit | None
    """The fit with which frames are normalised to equal brightness."""
    trusts_stated: bool
    """Whether they are normalised with the stated exposures alone."""
    changes: ChangeDetector
    """The detector of changes of the camera."""


def check_state(
    method: MaximumLikelihoodState, settings: DefaultSettings, size: ImageSize, max_grey: int, frames: int
) -> None:
    """Check that the default method can continue from a state after this many frames of a size and bit depth.

    Raises
    ------
    FormatError
        If a value is out of range, or values are inconsistent.
    """
    new = KeyframeSelector(settings.keyframes, settings.max_log_ratio)
    check_settings("keyframes", method.keyframes, new, "capacity max_log_ratio")
    kept = method.keyframes.numbers
    require(len(kept) <= settings.keyframes, "there are more keyframes than its settings allow")
    require(all(a < b for a, b in pairwise([*kept, frames])), "keyframes are out of order or do not exist")
    _check_data(method.data, EpochData.of(settings, size, max_grey), settings, frames)
    if method.fit is not None:
        _check_fit(method.fit)
        require(_is_quick(method.fit), "a quick fit has effects")
    _check_changes(method.changes, frames)


def _check_data(found: EpochData, new: EpochData, settings: DefaultSettings, frames: int) -> None:
    check_settings("data", found, new, "size")
    check_settings("reservoir", found.reservoir, new.reservoir, "capacity")
    _check_reservoir(found.reservoir, frames)
    check_settings("stationary", found.stationary, new.stationary, "stationary_px")
    if found.stationary.series is not None:
        check_settings("series", found.stationary.series, new.stationary.series, "pixels points frames")
        _check_series(found.stationary.series, new, frames)
    check_settings("noise", found.noise, new.noise, "max_grey")
    _check_noise(found.noise, frames)
    width, height = settings.preprocessor().small_size(new.size)
    area = found.scene_area
    for image in (area.brightest, area.allowed, area.fine, area.contrast, area.pairs):
        require(image is None or image.shape == (height, width), "its images of the scene area have another size")
    known = [one is not None for one in (area.fine, area.contrast, area.pairs)]
    require(all(known) or not any(known), "a part of its fine structure is missing")


def _check_noise(noise: NoiseEstimator, frames: int) -> None:
    found, waiting = (Numbers(0, 1, ("n",), most=NOISE_FRAMES), Numbers(0, 2, ("n",), most=MIN_NOISE_BLOCKS - 1))
    for ranges, rule in ((noise._found, found), (noise._waiting, waiting)):
        require(len(ranges) == NOISE_BINS, "its noise has another number of grey levels")
        for variances in ranges:
            rule.check("noise", variances)
    for variances, numbers in zip(noise._found, noise._frames, strict=True):
        require(len(numbers) == len(variances), "its noise has another number of frames than of variances")
        require(all(0 <= number < frames for number in numbers), "its noise is of frames that do not exist")


def _check_changes(found: ChangeDetector, frames: int) -> None:
    reference = found.reference
    if reference is not None:
        _check_fit(reference)
        require(found.complete_before >= 0 or _is_quick(reference), "a reference with effects is a complete fit")
    require(reference or not (found.pairs or found.seen), "changes are judged without a reference")
    require(found.grey_range.black < found.grey_range.white, "black is not below white")
    for pair in found.pairs:
        curves = 0 if reference is None else reference.vignette_part.stop
        Numbers(shape=(CHANGES, curves)).check("changes.pairs.fit_products", pair.fit_products)
        require(pair.frame0 < pair.frame1 < frames, "changes are of frames that do not exist")
    for seen in found.seen:
        _check_observations("changes.seen", seen, frames)
        require(len(seen) and seen.in_pairs, "a scene point was not seen in two frames")
    require(found.since is None or 0 <= found.since < frames, "a suspected change begins in the future")
    require(found.since is None or found.neighbours.errors, "a suspected change has no evidence")


def _check_reservoir(found: Reservoir, frames: int) -> None:
    kept = found.kept
    if kept is None:
        return
    require(kept.group[0] >= 0 and np.all(np.diff(kept.group) >= 0), "groups are mixed")
    require(np.all(kept.group == np.repeat(kept.group[kept.starts], kept.counts)), "groups share a point")
    _check_observations("reservoir", kept, frames)


def _check_observations(name: str, found: Observations, frames: int) -> None:
    require(found.frame.max(initial=0) < frames, "observations are of frames that do not exist")
    Numbers(0, 1, ("n",)).check(f"{name}.grey_variance", found.grey_variance)
    Numbers(-1, 1, ("n",)).check(f"{name}.grey_third_moment", found.grey_third_moment)
    Numbers(0, 10, ("n",)).check(f"{name}.gradient", found.gradient)


def _check_series(found: StaticSeries, data: EpochData, frames: int) -> None:
    (width, height), max_grey = data.size, data.noise.max_grey
    if found._places is None:
        require(not found._grey and not found._index, "the series has no positions")
        return
    require(found._size == data.size and found._max_grey == max_grey, "the series is of different frames")
    Numbers(0, width * height - 1, ("places",), most=found.pixels).check("series.places", found._places)
    one_kind = {grey.dtype for grey in found._grey} in ({np.dtype(np.uint8)}, {np.dtype(np.uint16)})
    require(one_kind, "the series mixes types of images")
    images = len(found._index)
    Numbers(0, max_grey, (images, len(found._places)), most=found.frames).check("series.grey", found._grey)
    Numbers(0, frames - 1, (images,)).check("series.index", found._index)
    require(np.all(np.diff(found._index) > 0), "the frames of the series are out of order")


def _is_quick(fit: Fit) -> bool:
    """Return whether a fit has neither effects nor gains of frames."""
    return fit.effects == Effects() and not fit.effect_estimates and not fit.errors.gain_variances


def _check_fit(fit: Fit) -> None:
    chosen = fit.effects.chosen
    require(len(set(chosen)) == len(chosen) and EFFECTS.keys() >= set(chosen), "the fit has unknown effects")
    steps = len(fit.effects.step_exposures)
    require(steps == STEP_EXPOSURES or not set(chosen) & set(GAIN_STEPS), "the fit has unknown gain steps")
    parameters = fit.vignette_part.stop + len(fit.effects)
    Numbers(-1e6, 1e6, (parameters,)).check("fit.parameters", fit.parameters)
    require(np.all(fit.response_parameters > 0), "the response of the fit does not increase")
    for name, covariance in (("fit.covariance", fit.covariance), ("fit.chance", fit.chance)):
        Numbers(shape=(parameters, parameters)).check(name, covariance)
        require(np.all(np.diag(covariance) >= 0), "the fit has negative variances")
    require(len(fit.errors.factors) in (0, len(FACTOR_GREYS)), "the error model has another number of factors")
