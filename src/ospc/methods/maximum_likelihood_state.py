"""What the default method must remember to go on where it stopped."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.correspondence.image_circle import ImageCircle
from ospc.correspondence.keyframe_selection import KeyframeSelectorState
from ospc.correspondence.noise_estimation import NoiseEstimator
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.estimation.fit import Fit


@dataclass(frozen=True)
class MaximumLikelihoodState:
    """All that :class:`~ospc.methods.maximum_likelihood.MaximumLikelihoodMethod` has learned.

    Attributes
    ----------
    passed_over, looks
        Where the schedule of frames to look at stands.
    partners
        What is known of the views kept; the views themselves are made again of their frames.
    reservoir
        The observations.
    series
        Pixels of a camera that may stand still; None once it moved.
    noise
        What was measured of the noise.
    fit
        The fit that registration relies on.
    motions
        Recent displacements in pixels.
    pairs
        Pairs of frames compared.
    circle
        Which part of the image ever sees light.
    log_exposures
        ln of the shortest and longest exposure in milliseconds.
    """

    passed_over: int
    looks: int
    partners: KeyframeSelectorState
    reservoir: Reservoir
    series: StaticSeries | None
    noise: NoiseEstimator
    fit: Fit | None
    motions: list[float]
    pairs: int
    circle: ImageCircle
    log_exposures: tuple[float, float]
