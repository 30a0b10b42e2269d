"""The state from which the default method continues an interrupted run."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.correspondence.keyframe_selection import KeyframeSelector
from ospc.correspondence.noise_estimation import NoiseEstimator
from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.scene_area import SceneArea
from ospc.correspondence.static_series import StaticSeries
from ospc.estimation.fit import Fit
from ospc.methods.change_detection import ChangeDetector


@dataclass(frozen=True)
class MaximumLikelihoodState:
    """The state of :class:`~ospc.methods.maximum_likelihood.MaximumLikelihoodMethod`.

    Attributes
    ----------
    keyframes
        Keyframes by their numbers; their images are read again.
    series
        Pixels of a camera that may be stationary; None once it moved.
    fit
        The fit that registration uses.
    motions, pairs
        Recent displacements in pixels, and number of compared pairs of frames.
    scene_area
        The part of the image that shows the scene.
    trusts_stated
        Whether frames are normalised to equal brightness with the stated exposures alone.
    inter_coded
        Whether the frames come from a video with inter-frame compression.
    """

    keyframes: KeyframeSelector
    reservoir: Reservoir
    series: StaticSeries | None
    noise: NoiseEstimator
    fit: Fit | None
    motions: list[float]
    pairs: int
    scene_area: SceneArea
    changes: ChangeDetector
    trusts_stated: bool
    inter_coded: bool
