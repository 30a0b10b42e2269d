"""The evidence of a run as one value: what a fit is made of, and the fit."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.arrays import ImageSize
from ospc.estimation.fit import Fit
from ospc.observations import ExposedObservations
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.noise import NoiseModel


@dataclass(frozen=True)
class FitInputs:
    """What calibrations, summaries and reports are made of.

    Attributes
    ----------
    size, max_grey
        Of the frames.
    noise
        Noise of single pixels.
    observations
        All observations with their exposures, their grey levels stretched where black and white are not the ends of
        the scale; None if there are none.
    fit
        Fit to the observations; None where they do not allow one.
    standing_still
        Whether the camera did not move.
    pairs
        Pairs of frames registered.
    usable_radius
        Radius in half diagonals that the usable part of the image reaches: less than 1 in a fisheye's image.
    grey_range
        Where black and white are.
    single_pixels
        Whether each observation is a single pixel instead of a mean of several.
    """

    size: ImageSize
    max_grey: int
    noise: NoiseModel
    observations: ExposedObservations | None
    fit: Fit | None
    standing_still: bool
    pairs: int
    usable_radius: float = 1.0
    grey_range: GreyRange = FULL_RANGE
    single_pixels: bool = False
