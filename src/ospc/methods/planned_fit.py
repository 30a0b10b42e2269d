"""The plan of the final fit that the settings prescribe."""

from __future__ import annotations

from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.photometry.noise import NoiseModel
from ospc.settings import DefaultSettings
from ospc.settings.vignette import MAX_VIGNETTE_REACH


def plan_of_moving_camera(settings: DefaultSettings, noise: NoiseModel | None, usable_radius: float) -> FitPlan:
    """Return the plan for a camera that moves; the usable radius is in half diagonals."""
    response = ResponseBasis(settings.response_intervals, settings.response_functions)
    widest = VignetteBasis(
        settings.radial_terms,
        free_centre=True,
        non_radial=True,
        usable_radius=usable_radius,
        reach=MAX_VIGNETTE_REACH,
    )
    return FitPlan(response, widest, noise, settings.rounds)


def plan_of_stationary_camera(settings: DefaultSettings, noise: NoiseModel | None) -> FitPlan:
    """Return the plan for a stationary camera, whose observations do not depend on the vignette."""
    response = ResponseBasis(settings.series_intervals, settings.response_functions)
    return FitPlan(response, VignetteBasis(0), noise, settings.rounds)
