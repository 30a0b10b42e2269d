"""What the default method keeps of the frames of an epoch, from which its results are made."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import ImageSize
from ospc.correspondence.flat_sampling import Samples
from ospc.correspondence.noise_estimation import NoiseEstimator
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.scene_area import SceneArea
from ospc.correspondence.static_series import StaticSeries
from ospc.estimation.black_level import black_level
from ospc.estimation.effect_choice import fit_with_chosen_effects
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.fitted import Fitted
from ospc.estimation.vignette_basis import measured_radius
from ospc.exposures.table import ExposureTable
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.stationary_camera import StationaryCamera
from ospc.observations import ExposedObservations, Observations
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.recording.frame import Frame
from ospc.settings import DefaultSettings
from ospc.settings.methods import INTER_CODED_SIGMAS
from ospc.settings.response import BLACK_LEVEL_ACCURACY, MIN_BLACK_LEVEL
from ospc.settings.vignette import MIN_USABLE_RADIUS


@dataclass
class EpochData:
    """The data of an epoch's frames of a size; create it with :meth:`of`."""

    size: ImageSize
    """Width and height of the frames in pixels."""
    reservoir: Reservoir
    """Observations of pairs of frames."""
    stationary: StationaryCamera
    """Whether the camera is stationary, and the observations if it is."""
    noise: NoiseEstimator
    """Noise of single pixels, also of earlier epochs."""
    scene_area: SceneArea
    """The part of the image that shows the scene, also of earlier epochs."""
    pairs: int = 0
    """Number of pairs compared."""
    inter_coded: bool = False
    """Whether the frames come from a video with inter-frame compression."""

    @classmethod
    def of(cls, settings: DefaultSettings, size: ImageSize, max_grey: int) -> EpochData:
        """Return the data before the first frame."""
        stationary = StationaryCamera(settings.stationary_px, StaticSeries(points=settings.series_points))
        return cls(size, Reservoir(settings.max_points), stationary, NoiseEstimator(max_grey), SceneArea())

    def since(self, number: int) -> EpochData:
        """Return the data of the frames from a number on, for an epoch that begins with it."""
        reservoir, pairs = self.reservoir.since(number)
        stationary = replace(self.stationary, series=None, motions=[])
        return replace(self, reservoir=reservoir, pairs=pairs, stationary=stationary)

    def observe(self, frame: Frame, prepared: PreprocessedFrame) -> None:
        """Add what the next frame shows alone, except its noise."""
        self.inter_coded |= frame.inter_coded
        self.scene_area.observe(prepared, frame.mask)
        self.stationary.observe(frame)

    def add(self, samples: Samples) -> None:
        """Add what the next pair of frames shows."""
        self.pairs += 1
        self.stationary.add_motion(samples.motion_px)
        self.reservoir.add(samples.observations)

    def observations(
        self, exposures: ExposureTable, grey_range: GreyRange = FULL_RANGE
    ) -> ExposedObservations | None:
        """Return all observations, with the currently known exposures; None if there are none."""
        series = self.stationary.used_series
        if series is not None:
            found = series.observations()
        elif self.reservoir.kept is not None:
            found = self.reservoir.kept
            # A surround and overlays are the same in all frames, whatever their exposures.
            seen = self.scene_area.shows_scene(found.position)
            found = found if seen is None else found.of_points(np.logical_and.reduceat(seen, found.starts))
        else:
            return None
        exposed = found.with_exposures(exposures).stretched(grey_range)
        if self.inter_coded:
            exposed = replace(exposed, error_factor=INTER_CODED_SIGMAS)
        return exposed if len(exposed) else None

    def usable_radius(self, observations: Observations) -> float:
        """Return the radius of the usable part, in half diagonals: up to a soft edge only as far as observed."""
        usable, circle = self.scene_area.usable_radius(), self.scene_area.soft_circle()
        if circle is None:
            return usable
        seen = min(measured_radius(observations, centre) for centre in (circle, np.zeros(2)))
        return min(usable, max(seen, MIN_USABLE_RADIUS)) if seen else usable

    def inputs(
        self,
        settings: DefaultSettings,
        exposures: ExposureTable,
        grey_range: GreyRange,
        least_black: float = MIN_BLACK_LEVEL,
    ) -> FitInputs:
        """Return the observations and the fit to them; if the fit shows a higher black level, that with it."""
        observations, noise = self.observations(exposures, grey_range), self.noise.model(exposures)
        fitted = None if observations is None else self._fitted(observations, noise, grey_range, settings)
        if fitted is not None and not self.stationary.is_stationary:
            black = black_level(fitted.fit, fitted.observations, least_black)
            if black > 0:
                return self.inputs(settings, exposures, grey_range.with_black_at(black), BLACK_LEVEL_ACCURACY)
        return FitInputs(
            size=self.size,
            max_grey=self.noise.max_grey,
            noise=noise,
            observations=observations,
            fitted=fitted,
            stationary=self.stationary.is_stationary,
            pairs=self.reservoir.groups_before(len(exposures), self.pairs),
            grey_range=grey_range,
            inter_coded=self.inter_coded,
            overlay_share=self.scene_area.overlay_share,
        )

    def _fitted(
        self, observations: ExposedObservations, noise: NoiseModel, grey_range: GreyRange, settings: DefaultSettings
    ) -> Fitted | None:
        if len(observations.starts) < settings.min_points:
            return None
        if observations.log_exposure_change(settings.min_points) < settings.min_log_exposure_change:
            return None
        if self.stationary.is_stationary:
            plan = FitPlan.of_stationary_camera(settings, noise=None)
        else:
            stretched = grey_range.stretched_noise(noise)
            plan = FitPlan.of_moving_camera(settings, stretched, self.usable_radius(observations))
        return fit_with_chosen_effects(observations, plan)
