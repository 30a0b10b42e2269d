"""The default method: register pairs of frames, sample flat points, and fit response and vignette jointly."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.correspondence.flat_sampling import NOTHING_FOUND, FlatSampler
from ospc.correspondence.keyframe_selection import KeyframeSelector
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.correspondence.registration import REGISTRARS
from ospc.correspondence.view_motion import homography
from ospc.errors import named
from ospc.exposures.lag_change import LagChange
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Change, ChangeDetector
from ospc.methods.epoch_data import EpochData
from ospc.methods.exposure_ratios import exposure_ratios
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState, check_state
from ospc.methods.method import Method, Progress, check_can_be_matched
from ospc.methods.preview import Preview
from ospc.methods.quick_fit import QuickFit
from ospc.methods.result import calibration_of
from ospc.observations import Observations
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.recording.frame import Frame
from ospc.settings import DefaultSettings
from ospc.settings.methods import (
    DROPPED_PAIRS,
    FIRST_QUICK_FIT_PAIRS,
    NEAR_WHITE,
    PAIRS_PER_DROPPED,
    QUICK_FIT_POINTS,
    REFERENCE_FIT_PAIRS,
)
from ospc.system.second_thread import SecondThread


class MaximumLikelihoodMethod(Method):
    """The presets ``default`` and ``fast``, for frames of a size in pixels and a largest grey value."""

    def __init__(self, settings: DefaultSettings, size: ImageSize, max_grey: int) -> None:
        check_can_be_matched(size)
        self._settings = settings
        self._size = size
        self._max_grey = max_grey
        self._second = SecondThread()
        self._data = EpochData.of(settings, size, max_grey)
        self._changes = ChangeDetector()
        self._select_keyframe = KeyframeSelector(settings.keyframes, settings.max_log_ratio)
        self._register = named("registration", settings.registration, REGISTRARS)(self._second)
        self._sample = FlatSampler(settings)
        self._quick_fit = QuickFit(settings, size, max_grey)
        self._latest: Observations | None = None
        self._lost = False
        self._inputs: dict[tuple[int, int, GreyRange], FitInputs] = {}

    def push(self, frame: Frame, prepared: PreprocessedFrame, exposures: ExposureTable) -> Change | None:
        """Process the next frame, and return the camera change that it proves, if any."""
        self._inputs = {}  # outdated, and as large as everything kept of the frames
        log_exposure = _log_exposure(exposures, prepared.number)
        self._changes.observe_time(prepared.number, frame.stamp_s)
        self._data.observe(frame, prepared)
        new_keyframe = self._second.submit(self._sample.keyframe, prepared)
        keyframe = self._select_keyframe.select(prepared.number, log_exposure)
        if keyframe is not None and not keyframe.grey_range.resembles(prepared.grey_range):
            self._forget_clipped_before(prepared)
            keyframe = None
        samples, registration = NOTHING_FOUND, None
        if keyframe is not None:
            area, frames = self._data.scene_area, np.array([keyframe.number, prepared.number])
            stated_log_ratio = float(np.diff(exposures.log_exposure_of(frames))[0])
            shown = area.shown()
            keyframe, prepared = replace(keyframe, shown=shown), replace(prepared, shown=shown)
            views = area.extended(keyframe, prepared)
            registration = self._register(*views, self._quick_fit.normalize, stated_log_ratio)
            if registration is not None and (motion := homography(registration.forward, shown)) is not None:
                area.compare(keyframe, prepared, motion)
        measured = self._second.submit(self._data.noise.observe, frame)  # after registration, which uses that thread
        if keyframe is not None:
            samples = self._sample(keyframe, prepared, registration, self._data.pairs)
            self._select_keyframe.update(keyframe, prepared.number, samples)
        self._lost = keyframe is not None and samples.overlap == 0
        self._select_keyframe.add(new_keyframe.result(), log_exposure)
        measured.result()
        if not len(samples.observations):
            return None
        self._data.add(samples)
        self._latest = samples.observations
        if self._data.pairs >= FIRST_QUICK_FIT_PAIRS and self._quick_fit_is_due:
            self._refine(exposures)
        return self.compare(samples.observations, exposures)

    def compare(self, points: Observations, exposures: ExposureTable) -> Change | None:
        """Process points that two frames share, and return the camera change that they prove.

        A new suspicion triggers a fit to all pairs so far.
        """
        was_suspicious = self._changes.is_suspicious
        change = self._changes.observe(points, exposures)
        if self._changes.is_suspicious and not was_suspicious:
            self._refine(exposures)
        return change

    # Steps of push.

    def _forget_clipped_before(self, frame: PreprocessedFrame) -> None:
        """Forget what was taken from earlier frames near white, which was not known then."""
        self._select_keyframe.forget_before(frame.number)
        self._data.reservoir.forget_above(frame.grey_range.white - NEAR_WHITE)

    @property
    def _quick_fit_is_due(self) -> bool:
        """Whether the number of pairs has doubled; without a fit, as after a change of the camera, more often."""
        pairs = self._data.pairs
        return pairs.bit_count() == 1 or (self._quick_fit.fit is None and pairs % FIRST_QUICK_FIT_PAIRS == 0)

    def _refine(self, exposures: ExposureTable) -> None:
        """Update the quick fit, by which registration normalises frames, and forget the first pairs, made without."""
        data = self._data
        if data.reservoir.points >= self._settings.min_points:
            some = data.reservoir.some(QUICK_FIT_POINTS).with_exposures(exposures)
            if some.log_exposure_change() >= self._settings.min_log_exposure_change:
                radius = data.scene_area.usable_radius()
                self._quick_fit.refine(some, data.noise.model(exposures), radius, trusts_stated=exposures.trusted)
                if self._quick_fit.fit is not None and data.pairs >= REFERENCE_FIT_PAIRS:
                    self._changes.set_reference(self._quick_fit.fit)
        # Early pairs were registered with an unknown vignette, which biases registration towards equal brightness:
        # once there are enough others, they do more harm than good.
        if data.pairs >= PAIRS_PER_DROPPED * FIRST_QUICK_FIT_PAIRS:
            data.reservoir.forget_before(min(data.pairs // PAIRS_PER_DROPPED, DROPPED_PAIRS))

    # Epochs and pauses.

    def prove_again(self, change: Change, before: FitInputs, exposures: ExposureTable) -> Change | None:
        """Prove a change of response or vignette again with the complete fit to the frames before it, if any.

        Later pairs are compared with that fit, and the first frame of the change is determined with it.
        """
        if change.part == "exposures" or before.fit is None:
            return change
        proven = self._changes.prove_again(change, before.fit, before.grey_range, exposures)
        if proven is None:
            return None
        observed = self._data.reservoir.since(self._changes.first_searched(change))[0].kept
        return proven if observed is None else self._changes.located(proven, observed, exposures)

    def agrees_with(self, change: LagChange, exposures: ExposureTable) -> bool:
        """Return whether the quick fit predicts the pairs since a change of the lag no worse with the new lag.

        It has a response, so it is not misled by grey levels that follow the exposures unequally.
        """
        fit, observed = self._quick_fit.fit, self._data.reservoir.since(change.frame)[0].kept
        if fit is None or observed is None:
            return True
        new = replace(exposures, lag_frames=exposures.lag_frames + change.later_frames)
        ratios = (exposure_ratios(fit, observed.with_exposures(table)) for table in (exposures, new))
        misfit, new_misfit = (np.median(np.abs(each.log_residual)) if len(each.metadata) else 0.0 for each in ratios)
        return bool(new_misfit <= misfit)

    def end_threads(self) -> None:
        """End the second thread; the next frame starts it again."""
        self._second.end()

    def since(self, number: int) -> MaximumLikelihoodMethod:
        """Return a method that continues with the observations from a frame on; this one is not used any more."""
        later = MaximumLikelihoodMethod(self._settings, self._size, self._max_grey)
        later._data = self._data.since(number)
        later._select_keyframe = self._select_keyframe
        later._select_keyframe.forget_before(number)
        return later

    @property
    def longest_pause(self) -> int:
        """Maximum number of frames to skip: none in a short series of a stationary camera or during a suspicion.

        If a frame overlaps too little with its keyframe, the next one is chosen to overlap more.
        """
        series = self._data.stationary.used_series
        if (series is not None and not series.full) or self._changes.is_suspicious:
            return 0
        return self._select_keyframe.best_age - 1 if self._lost else sys.maxsize

    @property
    def progress(self) -> Progress:
        """The current progress."""
        quick = self._quick_fit
        return Progress(self._data.pairs, self._data.reservoir.points, quick.response_sigma, quick.vignette_sigma)

    # Current results.

    def preview(self, exposures: ExposureTable) -> Preview | None:
        """Return the current state without a new fit; None before there are observations."""
        observations = self._data.observations(exposures)
        if observations is None:
            return None
        latest = None if self._latest is None else self._latest.with_exposures(exposures)
        return Preview(self._size, self._max_grey, self._data.pairs, observations, latest, self._quick_fit.fit)

    def inputs(self, exposures: ExposureTable, grey_range: GreyRange = FULL_RANGE) -> FitInputs:
        """Return all observations with the currently known exposures, and the fit to them.

        The result is cached for repeated calls with the same exposures.
        """
        frames = len(exposures)
        key = (frames, exposures.lag_frames, grey_range)
        if key not in self._inputs:
            # For the same frames, recorded and lag-corrected exposures are requested in turn.
            of_same_frames = {other: known for other, known in self._inputs.items() if other[0] == frames}
            self._inputs = {**of_same_frames, key: self._data.inputs(self._settings, exposures, grey_range)}
        return self._inputs[key]

    def calibration(self, exposures: ExposureTable, grey_range: GreyRange = FULL_RANGE) -> Calibration:
        """Return the calibration from all observations so far."""
        return calibration_of(self.inputs(exposures, grey_range), self._settings)

    def state(self) -> MaximumLikelihoodState:
        """Return the state; call it before the next frame is pushed."""
        return MaximumLikelihoodState(
            keyframes=self._select_keyframe,
            data=self._data,
            fit=self._quick_fit.fit,
            trusts_stated=self._quick_fit.trusts_stated,
            changes=self._changes,
        )

    def restore(self, state: MaximumLikelihoodState, frames: int) -> None:
        """Continue from a state after this many frames; replay :attr:`frames_to_replay` before pushing the next one.

        Raises
        ------
        FormatError
            If a value is out of range, or values are inconsistent.
        """
        check_state(state, self._settings, self._size, self._max_grey, frames)
        self._select_keyframe, self._data, self._changes = state.keyframes, state.data, state.changes
        if state.fit is not None:
            self._quick_fit.rely_on(state.fit, trusts_stated=state.trusts_stated)

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Numbers of the keyframes of the restored state that are still missing."""
        return self._select_keyframe.frames_to_replay

    def replay(self, prepared: PreprocessedFrame) -> None:
        """Process a keyframe of the restored state again."""
        if prepared.number in self.frames_to_replay:
            self._select_keyframe.replay(self._sample.keyframe(prepared))


def _log_exposure(exposures: ExposureTable, number: int) -> float:
    """Return ln of a frame's exposure; the recorded value if the corrected one is not known yet."""
    found: FloatArray = exposures.log_exposure_of(np.array([number]))
    return float(found[0] if np.isfinite(found[0]) else exposures.log_recorded[number])
