"""What is fitted to observations, except for the choices that the observations decide."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.estimation.maximum_likelihood import fit_model
from ospc.estimation.model import Model
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.settings import DefaultSettings
from ospc.settings.vignette import MAX_VIGNETTE_REACH


@dataclass(frozen=True)
class FitPlan:
    """What is fitted to observations."""

    response: ResponseBasis
    """Basis of the response."""
    widest: VignetteBasis
    """The vignette model with the most parameters and the farthest knots."""
    noise: NoiseModel | None
    """Noise of single pixels; None if the observations are single pixels."""
    rounds: int
    """Maximum number of rounds of each fit after the first in which outliers lose weight."""

    @classmethod
    def of_moving_camera(cls, settings: DefaultSettings, noise: NoiseModel | None, usable_radius: float) -> FitPlan:
        """Return the plan of the final fit for a camera that moves; the usable radius is in half diagonals."""
        terms, reach = settings.radial_terms, MAX_VIGNETTE_REACH
        widest = VignetteBasis(terms, free_centre=True, non_radial=True, usable_radius=usable_radius, reach=reach)
        return cls(
            ResponseBasis(settings.response_intervals, settings.response_functions), widest, noise, settings.rounds
        )

    @classmethod
    def of_stationary_camera(cls, settings: DefaultSettings, noise: NoiseModel | None) -> FitPlan:
        """Return the same for a stationary camera, whose observations do not depend on the vignette."""
        response = ResponseBasis(settings.series_intervals, settings.response_functions)
        return cls(response, VignetteBasis(0), noise, settings.rounds)

    def fit(
        self, observations: ExposedObservations, vignette: VignetteBasis, effects: Effects, start: Fit | None = None
    ) -> Fit:
        """Fit a choice of vignette model and effects, starting from an earlier fit if there is one."""
        return fit_model(Model(self.response, vignette, effects), self.noise, observations, self.rounds, start)

    def refit(self, observations: ExposedObservations, start: Fit) -> Fit:
        """Fit the model of an earlier fit, starting from it."""
        return self.fit(observations, start.vignette_basis, start.effects, start)
