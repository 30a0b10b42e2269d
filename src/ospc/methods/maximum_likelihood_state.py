"""What the default method must remember to go on where it stopped."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.correspondence.image_circle import ImageCircle
from ospc.correspondence.keyframe_selection import KeyframeSelectorState
from ospc.correspondence.noise_estimation import NoiseEstimator
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.estimation.fit import Fit
from ospc.methods.change_detection import ChangeDetector


@dataclass(frozen=True)
class MaximumLikelihoodState:
    """All that :class:`~ospc.methods.maximum_likelihood.MaximumLikelihoodMethod` has learned.

    Attributes
    ----------
    keyframes
        What is known of the keyframes; their images are read again.
    series
        Pixels of a camera that may stand still; None once it moved.
    fit
        The fit that registration relies on.
    motions, pairs
        Recent displacements in pixels, and number of pairs of frames compared.
    circle
        Which part of the image ever sees light.
    trusts_stated
        Whether frames are brought to equal brightness by the exposures stated alone.
    """

    keyframes: KeyframeSelectorState
    reservoir: Reservoir
    series: StaticSeries | None
    noise: NoiseEstimator
    fit: Fit | None
    motions: list[float]
    pairs: int
    circle: ImageCircle
    changes: ChangeDetector
    trusts_stated: bool
