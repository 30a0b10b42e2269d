"""The state from which the default method continues an interrupted run."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.correspondence.keyframe_selection import KeyframeSelector
from ospc.estimation.fit import Fit
from ospc.methods.change_detection import ChangeDetector
from ospc.methods.epoch_data import EpochData


@dataclass(frozen=True)
class MaximumLikelihoodState:
    """The state of :class:`~ospc.methods.maximum_likelihood.MaximumLikelihoodMethod`.

    Attributes
    ----------
    keyframes
        Keyframes by their numbers; their images are read again.
    data
        What is kept of the frames of the current epoch.
    fit, trusts_stated
        The fit with which frames are normalised to equal brightness, and whether with the stated exposures alone.
    changes
        The detector of changes of the camera.
    """

    keyframes: KeyframeSelector
    data: EpochData
    fit: Fit | None
    trusts_stated: bool
    changes: ChangeDetector
