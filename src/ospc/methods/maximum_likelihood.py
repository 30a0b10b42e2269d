"""The default method: compare the frames worth comparing, fit everything at once, say how sure that is."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import ImageSize
from ospc.correspondence.flat_sampling import FlatSampler, Samples
from ospc.correspondence.image_circle import ImageCircle
from ospc.correspondence.keyframe_selection import KeyframeSelector, KeyframeSelectorState
from ospc.correspondence.noise_estimation import NoiseEstimator
from ospc.correspondence.preprocessing import PreprocessedFrame, Preprocessor
from ospc.correspondence.registration import DenseRegistration, ExposureNormalizer
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.estimation.fit import Fit
from ospc.estimation.maximum_likelihood import MaximumLikelihoodEstimator
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.methods.method import Progress, check_size
from ospc.methods.preview import Preview, preview_of
from ospc.methods.summary import Evidence, response_of, summarise
from ospc.observations import Observations
from ospc.photometry.calibration import Calibration
from ospc.photometry.noise import NoiseModel
from ospc.recording.frame import Frame
from ospc.settings import DefaultSettings

_FIRST_REFINEMENT = 16
_LAST_FORGOTTEN = 32
_REFINEMENT_POINTS = 5000
_REFINEMENT_ROUNDS = 3


@dataclass
class Schedule:
    """Decides which frames are looked at: all at first, fewer the more has been seen.

    Attributes
    ----------
    frames_per_slowdown
        After so many looks, one more frame is passed over between looks.
    enough
        Beyond so many looks, pauses grow faster: with the fourth power of their number.
    """

    frames_per_slowdown: int
    enough: int = 10**9
    _wait: int = 0
    _looks: int = 0

    @property
    def wants_next(self) -> bool:
        """Whether the next frame is worth looking at."""
        return self._wait == 0

    def wants(self, places: int) -> bool:
        """Whether the frame so many places on (1 for the next) is worth looking at."""
        ahead = replace(self)
        for _ in range(places - 1):
            ahead.advance()
        return ahead.wants_next

    def advance(self) -> None:
        """Go on to the frame after the next one, which was looked at if it was wanted."""
        if self._wait > 0:
            self._wait -= 1
        else:
            self._wait = self._looks // self.frames_per_slowdown
            if self._looks > self.enough:
                self._wait = self._wait * self._looks**3 // self.enough**3
            self._looks += 1


class MaximumLikelihoodMethod:
    """The preset ``default``.

    Parameters
    ----------
    settings
        Every number of the method.
    size
        Width and height of the frames in pixels.
    max_grey
        Largest grey value of the frames.
    """

    def __init__(self, settings: DefaultSettings, size: ImageSize, max_grey: int) -> None:
        check_size(size)
        self._settings = settings
        self._size = size
        self._max_grey = max_grey
        self._schedule = Schedule(settings.frames_per_slowdown, settings.dense_frames)
        self._make_view = Preprocessor(settings.longest_side_px, settings.smoothing_px)
        self._partners = KeyframeSelector(settings.views, settings.max_log_ratio)
        self._second = ThreadPoolExecutor(1, "ospc-second")
        self._register = DenseRegistration(self._second)
        self._normalizer = ExposureNormalizer()
        self._sample = FlatSampler(
            spacing_px=settings.grid_spacing_px,
            max_gradient=settings.max_gradient,
            max_forward_backward_error_px=settings.max_forward_backward_error_px,
            max_points=settings.points_per_pair,
        )
        self._reservoir = Reservoir(settings.max_points)
        self._series: StaticSeries | None = StaticSeries(points=settings.series_pixels)
        self._noise = NoiseEstimator(max_grey)
        self._circle = ImageCircle()
        self._basis = ResponseBasis(settings.response_intervals)
        self._fit: Fit | None = None
        self._latest: Observations | None = None
        self._motions: list[float] = []
        self._response_spread: float | None = None
        self._pairs = 0
        self._log_exposures = (np.inf, -np.inf)
        self._evidence: Evidence | None = None
        self._to_recall: KeyframeSelectorState | None = None

    def push(self, frame: Frame) -> None:
        """Take the next frame; most often it is not even decoded."""
        # Nothing is noted before the image has been read: a frame that cannot be leaves no trace.
        view = self._look_at(frame) if self._schedule.wants_next else None
        self._evidence = self._to_recall = None
        self._watch_standing_still(frame)
        self._note_exposure(frame)
        self._schedule.advance()
        if view is not None:
            self._compare(view)

    def foresees(self, places: int) -> bool:
        """Whether the frame so many places on (1 for the next) will most likely be looked at."""
        return self._schedule.wants(places)

    @property
    def max_grey(self) -> int:
        """Largest grey value of the frames."""
        return self._max_grey

    @property
    def progress(self) -> Progress:
        """How far it has come."""
        if self._fit is None:
            return Progress(self._pairs, self._reservoir.points)
        return Progress(
            self._pairs, self._reservoir.points, self._response_spread, self._fit.vignette_sigma_at_corner
        )

    def preview(self) -> Preview | None:
        """Return what is known without a new fit; None before anything was seen."""
        observations = self._observations()
        if observations is None:
            return None
        return preview_of(
            observations, self._latest, self._fit, size=self._size, max_grey=self._max_grey, pairs=self._pairs
        )

    def calibration(self) -> Calibration:
        """Return what all that was seen amounts to."""
        return summarise(self.evidence(), self._settings)

    def evidence(self) -> Evidence:
        """Return all that was seen, and the fit to it; asked for again, without fitting again."""
        if self._evidence is None:
            self._evidence = self._new_evidence()
        return self._evidence

    def state(self) -> MaximumLikelihoodState:
        """Return all that was learned; to be used before the next frame is pushed."""
        return MaximumLikelihoodState(
            passed_over=self._schedule._wait,
            looks=self._schedule._looks,
            partners=self._partners.state() if self._to_recall is None else self._to_recall,
            reservoir=self._reservoir,
            series=self._series,
            noise=self._noise,
            fit=self._fit,
            motions=self._motions,
            pairs=self._pairs,
            circle=self._circle,
            log_exposures=self._log_exposures,
        )

    @classmethod
    def from_state(
        cls, settings: DefaultSettings, size: ImageSize, max_grey: int, state: MaximumLikelihoodState
    ) -> MaximumLikelihoodMethod:
        """Go on from a state; frames :attr:`wanted` should be given to :meth:`recall` before the next is pushed.

        Raises
        ------
        ValueError
            If it is none that :meth:`state` returns.
        """
        method = cls(settings, size, max_grey)
        method._schedule = Schedule(
            settings.frames_per_slowdown, settings.dense_frames, state.passed_over, state.looks
        )
        method._partners.restore(state.partners)
        method._reservoir, method._series, method._noise = state.reservoir, state.series, state.noise
        method._motions, method._pairs, method._log_exposures = state.motions, state.pairs, state.log_exposures
        method._circle = state.circle
        method._to_recall = state.partners
        if state.fit is not None:
            method._rely_on(state.fit)
        return method

    @property
    def wanted(self) -> frozenset[int]:
        """Indices of the frames that the state it goes on from was comparing with."""
        return frozenset() if self._to_recall is None else frozenset(self._to_recall.frames.tolist())

    def recall(self, frame: Frame) -> None:
        """Look again at a frame that new ones were being compared with."""
        if self._to_recall is not None:
            self._partners.recall(self._make_view(frame), self._to_recall)

    def _new_evidence(self) -> Evidence:
        observations = self._observations()
        changes = self._log_exposures[1] - self._log_exposures[0]
        enough = observations is not None and len(observations.starts) >= self._settings.min_points
        fit = None
        if observations is not None and enough and changes >= self._settings.min_log_exposure_change:
            fit = fit_with_chosen_vignette(
                observations,
                self._response_basis(),
                self._widest_vignette(),
                self._pixel_noise(),
                self._settings.rounds,
            )
        return Evidence(
            size=self._size,
            max_grey=self._max_grey,
            noise=self._noise.model(),
            observations=observations,
            fit=fit,
            exposure_range_ms=(float(np.exp(self._log_exposures[0])), float(np.exp(self._log_exposures[1]))),
            standing_still=self._standing_still,
            pairs=self._pairs,
            usable_radius=self._circle.usable_radius(),
        )

    # What push does besides comparing.

    def _look_at(self, frame: Frame) -> PreprocessedFrame:
        # Black pixels tell nothing about noise, and masked ones must not.
        image = frame.image if frame.mask is None else np.where(frame.mask, frame.image, 0)
        # Two looks at one image that do not need each other, and both leave the interpreter to others.
        noted = self._second.submit(self._noise.watch, image)
        view = self._make_view(frame)
        noted.result()
        self._circle.watch(view, frame.mask)
        return view

    def _compare(self, view: PreprocessedFrame) -> None:
        partner = self._partners.choose(view)
        if partner is not None:
            registration = self._register(partner, view, self._normalizer)
            samples = self._sample(partner, view, registration, self._pairs)
            self._partners.learn(partner, samples)
            self._keep(samples)
        self._partners.add(view)

    def _note_exposure(self, frame: Frame) -> None:
        log_exposure = float(np.log(frame.exposure_ms))
        self._log_exposures = (min(self._log_exposures[0], log_exposure), max(self._log_exposures[1], log_exposure))

    def _watch_standing_still(self, frame: Frame) -> None:
        if self._series is not None:
            self._series.watch(frame)
            # Dark frames register badly: only plain motion, or long evidence, rules out that the camera stands still.
            plain = len(self._motions) >= 8 and float(np.median(self._motions)) > 4 * self._settings.still_px
            if plain or (len(self._motions) >= 60 and not self._standing_still):
                self._series = None

    def _keep(self, samples: Samples) -> None:
        self._pairs += 1
        if np.isfinite(samples.motion_px):
            self._motions = [*self._motions, samples.motion_px][-200:]
        self._reservoir.add(samples.observations)
        self._latest = samples.observations
        if self._pairs >= _FIRST_REFINEMENT and self._pairs.bit_count() == 1:
            self._refine()
            # Early pairs were registered with a vignette not yet known, which draws registration a little to where
            # brightness agrees: once there are enough others they do more harm than good.
            if self._pairs >= 4 * _FIRST_REFINEMENT:
                self._reservoir.forget_before(min(self._pairs // 4, _LAST_FORGOTTEN))

    def _refine(self) -> None:
        """Improve the equalisation that registration relies on, with a quick fit to some of the observations."""
        if self._reservoir.points < self._settings.min_points:
            return
        some = self._reservoir.some(_REFINEMENT_POINTS)
        rounds = self._settings.rounds if self._fit is None else _REFINEMENT_ROUNDS
        estimator = MaximumLikelihoodEstimator(
            self._basis, VignetteBasis(self._settings.radial_terms), self._noise.model(), rounds
        )
        self._rely_on(estimator.fit(some, self._fit))

    def _rely_on(self, fit: Fit) -> None:
        """Equalise frames by a fit from now on."""
        self._fit = fit
        spread = response_of(fit, self._max_grey).inverse_sigma
        self._response_spread = None if spread is None else float(spread.max())
        reliable = fit.vignette_sigma_at_corner < 0.05
        vignette = fit.vignette_basis.vignette(fit.vignette_parameters, self._size)
        self._normalizer = ExposureNormalizer(response_of(fit, 255), vignette if reliable else None)

    # What the frames seen so far amount to.

    @property
    def _standing_still(self) -> bool:
        return len(self._motions) > 0 and float(np.median(self._motions)) <= self._settings.still_px

    @property
    def _series_stands_in(self) -> bool:
        return self._standing_still and self._series is not None

    def _observations(self) -> Observations | None:
        if self._series is not None and self._series_stands_in:
            return self._series.observations()
        return self._lit(self._reservoir.all()) if self._reservoir.points else None

    def _lit(self, observations: Observations) -> Observations:
        """Return the observations without those of a surround that never sees light: it is alike in all frames."""
        seen = self._circle.sees(observations.position)
        return (
            observations
            if seen is None
            else observations.of_points(np.logical_and.reduceat(seen, observations.starts))
        )

    def _response_basis(self) -> ResponseBasis:
        return ResponseBasis(self._settings.series_intervals) if self._series_stands_in else self._basis

    def _pixel_noise(self) -> NoiseModel | None:
        return None if self._series_stands_in else self._noise.model()

    def _widest_vignette(self) -> VignetteBasis:
        if self._standing_still:
            return VignetteBasis(0)
        return VignetteBasis(self._settings.radial_terms, free_centre=True, non_radial=True)
