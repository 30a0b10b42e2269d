"""The data that calibrations, summaries and reports of a run are made from: observations, fit and image data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import counted
from ospc.estimation.fit import Fit
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
    """The data of calibrations, summaries and reports.

    Attributes
    ----------
    size, max_grey
        Size in pixels and largest grey value of the frames.
    noise
        Noise of single pixels.
    observations, fit
        The observations with their exposures, stretched to the grey range, and the fit to them; None if there are
        none or they do not allow a fit.
    standing_still
        Whether the camera was stationary: each observation is then a single pixel instead of a mean of several.
    pairs
        Number of pairs of frames registered.
    grey_range
        Grey levels of black and white.
    inter_coded
        Whether the frames come from a video with inter-frame compression, see :data:`INTER_CODED_SIGMAS`.
    overlay_share
        Share of the image that shows something fixed to the camera, which is not used.
    misregistered
        Number of pairs of frames that were registered wrongly, whose observations are left out.
    registered
        The observations, and those of pairs that are left out because their exposures are wrong; None if there are
        none.
    """

    size: ImageSize
    max_grey: int
    noise: NoiseModel
    observations: ExposedObservations | None
    fit: Fit | None
    standing_still: bool
    pairs: int
    grey_range: GreyRange = FULL_RANGE
    inter_coded: bool = False
    overlay_share: float = 0.0
    misregistered: int = 0
    registered: ExposedObservations | None = None

    @property
    def effects(self) -> tuple[EffectEstimate, ...]:
        """The estimates of effects other than response and vignette; empty without a fit."""
        return () if self.fit is None else self.fit.effect_estimates

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the frames."""
        overlay = _OVERLAY.format(share=100 * self.overlay_share) if self.overlay_share else ""
        misregistered = _MISREGISTERED.format(pairs=counted(self.misregistered, "pair")) if self.misregistered else ""
        inter_coded = _INTER_CODED if self.inter_coded else ""
        notes = [self.grey_range.note(self.max_grey), overlay, misregistered, self._wrongly_exposed, inter_coded]
        return tuple(filter(None, notes))

    @property
    def _wrongly_exposed(self) -> str:
        """Note on pairs that are left out because their exposures are wrong; empty if there are none."""
        if self.registered is None or self.fit is None:
            return ""
        pairs, least = len(np.unique(self.registered.group)), float(np.expm1(CONTRADICTING_PAIR_LOG))
        return _WRONGLY_EXPOSED.format(wrong=pairs - self.fit.groups, pairs=counted(pairs, "pair"), least=least)

    @property
    def _compared(self) -> ExposedObservations | None:
        """The observations of all pairs whose exposure ratios are estimated."""
        return self.observations if self.registered is None else self.registered

    @cached_property
    def ratios(self) -> ExposureRatios:
        """The exposure ratios of all pairs of frames; empty without a fit."""
        if self.fit is None or self._compared is None:
            return ExposureRatios.none()
        return exposure_ratios(self.fit, self._compared)

    @cached_property
    def corrected_ratios(self) -> ExposureRatios:
        """The same ratios, compared with those of the exposures as the fit corrected them."""
        ratios = self.ratios
        if self.fit is None or self._compared is None or not len(self.fit.effects):
            return ratios
        frames, first = np.unique(self._compared.frame, return_index=True)
        error = self.fit.log_exposure_error(self._compared)[first][np.searchsorted(frames, ratios.frames)]
        return replace(ratios, metadata=ratios.metadata * np.exp(error[:, 0] - error[:, 1]))
