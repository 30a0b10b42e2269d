"""The data that calibrations, summaries and reports of a run are made from: observations, fit and image data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import counted
from ospc.estimation.fit import Fit, measured_greys
from ospc.estimation.fitted import Fitted
from ospc.methods.exposure_ratios import exposure_ratios
from ospc.observations import ExposedObservations
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.photometry.verdict import EffectEstimate
from ospc.settings.brightness import CONTRADICTING_PAIR_LOG

_INTER_CODED = (
    "inter-frame compression of the video loses small changes of brightness, so all standard deviations are doubled; "
    "record images or MJPEG for more accuracy"
)

_MISREGISTERED = (
    "not used: {pairs} of frames whose points disagree with each other, usually because of repetitive texture, which "
    "is registered wrongly, or reflections"
)

_WRONGLY_EXPOSED = (
    "not used: {wrong} of {pairs} of frames, because they are brighter or darker than their exposures predict, by "
    "{least:.0%} or more"
)

_OVERLAY = (
    "{share:.2g} % of the image shows something fixed to the camera, such as an overlay, part of the vehicle or "
    "dirt, and is not used; the vignette does not include it"
)


@dataclass(frozen=True)
class FitInputs:
    """The data of calibrations, summaries and reports."""

    size: ImageSize
    """Size of the frames in pixels."""
    max_grey: int
    """Largest grey value of the frames."""
    noise: NoiseModel
    """Noise of single pixels."""
    observations: ExposedObservations | None
    """All observations with their exposures, stretched to the grey range; None if there are none."""
    fitted: Fitted | None
    """The fit to those of pairs that are registered and exposed rightly; None if they do not allow one."""
    stationary: bool
    """Whether the camera was stationary: each observation is then a single pixel instead of a mean of several."""
    pairs: int
    """Number of pairs of frames registered."""
    grey_range: GreyRange = FULL_RANGE
    """Grey levels of black and white."""
    inter_coded: bool = False
    """Whether the frames come from a video with inter-frame compression, see :data:`INTER_CODED_SIGMAS`."""
    overlay_share: float = 0.0
    """Share of the image that shows something fixed to the camera, which is not used."""

    @property
    def fit(self) -> Fit | None:
        """The fit; None if the observations do not allow one."""
        return None if self.fitted is None else self.fitted.fit

    @property
    def used(self) -> ExposedObservations | None:
        """The observations that the fit is to; without a fit, all."""
        return self.observations if self.fitted is None else self.fitted.observations

    @property
    def radial_motion(self) -> float:
        """Radial displacement, in half diagonals, of the scene points that determine the vignette."""
        return 0.0 if self.used is None or self.stationary else self.used.radial_motion

    @property
    def support(self) -> tuple[float, float]:
        """Lowest and highest grey level at which observations measure the response; all of them without any."""
        low, high = self.grey_range.grey((0.0, 1.0) if self.used is None else measured_greys(self.used)).tolist()
        return low, high

    @property
    def effects(self) -> tuple[EffectEstimate, ...]:
        """The estimates of effects other than response and vignette; empty without a fit."""
        return () if self.fit is None else self.fit.effect_estimates

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the frames."""
        overlay = _OVERLAY.format(share=100 * self.overlay_share) if self.overlay_share else ""
        inter_coded = _INTER_CODED if self.inter_coded else ""
        notes = [self.grey_range.note(self.max_grey), overlay, *self._left_out(), inter_coded]
        return tuple(filter(None, notes))

    def _left_out(self) -> Iterator[str]:
        """Yield notes on the pairs of frames that the fit does not use."""
        if self.fitted is None or self.observations is None:
            return
        pairs, registered = (len(np.unique(each.group)) for each in (self.observations, self.fitted.compared))
        if misregistered := pairs - registered:
            yield _MISREGISTERED.format(pairs=counted(misregistered, "pair"))
        if wrong := registered - self.fitted.fit.groups:
            least = float(np.expm1(CONTRADICTING_PAIR_LOG))
            yield _WRONGLY_EXPOSED.format(wrong=wrong, pairs=counted(registered, "pair"), least=least)

    @cached_property
    def ratios(self) -> ExposureRatios:
        """The exposure ratios of all pairs of frames; empty without a fit."""
        if self.fitted is None:
            return ExposureRatios.none()
        return exposure_ratios(self.fitted.fit, self.fitted.compared)

    @cached_property
    def corrected_ratios(self) -> ExposureRatios:
        """The same ratios, compared with those of the exposures as the fit corrected them."""
        ratios = self.ratios
        if self.fitted is None or not len(self.fitted.fit.effects):
            return ratios
        fit, compared = self.fitted.fit, self.fitted.compared
        frames, first = np.unique(compared.frame, return_index=True)
        error = fit.log_exposure_error(compared)[first][np.searchsorted(frames, ratios.frames)]
        return replace(ratios, metadata=ratios.metadata * np.exp(error[:, 0] - error[:, 1]))
