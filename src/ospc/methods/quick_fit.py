"""Quick fits during a run, which provide registration with the current response and vignette."""

from __future__ import annotations

import numpy as np

from ospc.arrays import ImageSize
from ospc.correspondence.exposure_normalizer import ExposureNormalizer
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.methods.exposure_ratios import exposure_ratios, unexplained_share
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.settings import DefaultSettings
from ospc.settings.methods import (
    CONTRADICTING_UNEXPLAINED_SHARE,
    MAX_VIGNETTE_SIGMA,
    QUICK_FIT_RADIAL_TERMS,
    QUICK_FIT_ROUNDS,
)


class QuickFit:
    """The latest fit to some of the observations, and its use for the next frames."""

    def __init__(self, settings: DefaultSettings, size: ImageSize, max_grey: int) -> None:
        self._settings, self._size, self._max_grey = settings, size, max_grey
        self._basis = ResponseBasis(settings.response_intervals, settings.response_functions)
        self.fit: Fit | None = None
        """The fit; None before there is one."""
        self.normalize = ExposureNormalizer()
        """Normalises frames to equal brightness with the fit, before they are registered."""
        self.trusts_stated = False
        """Whether normalisation uses only the stated exposures."""
        self.response_sigma: float | None = None
        """Largest standard deviation of g over the grey levels, with its scale fixed; None without a fit."""
        self.vignette_sigma: float | None = None
        """Standard deviation of V at the corners; None without a fit."""

    def refine(
        self, observations: ExposedObservations, noise: NoiseModel, usable_radius: float, *, trusts_stated: bool
    ) -> None:
        """Fit again, starting from the latest fit, to observations whose exposures may or may not be trusted.

        A fit whose exposures contradict the images is not used: with its response, no frame could be registered.
        """
        rounds = self._settings.rounds if self.fit is None else QUICK_FIT_ROUNDS
        vignette = VignetteBasis(QUICK_FIT_RADIAL_TERMS, free_centre=True, usable_radius=usable_radius)
        plan = FitPlan(self._basis, vignette, noise, rounds)
        fit = fit_with_chosen_vignette(observations, plan, start=self.fit).fit
        if unexplained_share(exposure_ratios(fit, observations)) <= CONTRADICTING_UNEXPLAINED_SHARE:
            self.rely_on(fit, trusts_stated=trusts_stated)

    def rely_on(self, fit: Fit, *, trusts_stated: bool) -> None:
        """Use a fit to normalise frames to equal brightness from now on."""
        self.fit, self.trusts_stated = fit, trusts_stated
        sigma = fit.response(self._max_grey).inverse_sigma
        self.response_sigma = None if sigma is None else float(sigma.max())
        errors = fit.vignette_errors(self._size)
        self.vignette_sigma = errors.sigma_at_corner
        reliable = errors.chance_sigma_at_corner < MAX_VIGNETTE_SIGMA
        vignette = fit.usable_vignette(self._size) if reliable else None
        log_response = np.interp(np.arange(256) / 255, fit.response_basis.grid, fit.log_response)
        self.normalize = ExposureNormalizer(log_response, vignette, trusts_stated=trusts_stated)
