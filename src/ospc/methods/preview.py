"""Quick estimates of a method during a run, cheap enough to request repeatedly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ospc.arrays import ByValue, FloatArray, ImageSize
from ospc.estimation.fit import Fit, measured_greys
from ospc.methods.coverage import coverage_of
from ospc.methods.result import vignette_sigma
from ospc.observations import ExposedObservations
from ospc.photometry.coverage import Coverage
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette


@dataclass(frozen=True, eq=False)
class Preview(ByValue):
    """The observations so far, and estimates from the latest quick fit to some of them.

    The estimates have no verdict yet; their standard deviations indicate how reliable they are.
    """

    size: ImageSize
    """Width and height of the frames in pixels."""
    max_grey: int
    """Their largest grey value."""
    pairs: int
    """Number of pairs of frames compared so far."""
    observations: ExposedObservations
    """All observations."""
    latest: ExposedObservations | None
    """Those of the latest pair of frames; None if it had none."""
    fit: Fit | None
    """The latest quick fit; None before there is one."""

    @cached_property
    def coverage(self) -> Coverage:
        """Coverage of the observations, without residuals."""
        return coverage_of(self.observations, None, self.size)

    @cached_property
    def response(self) -> Response | None:
        """The response; None without a fit."""
        return None if self.fit is None else self.fit.response(self.max_grey, measured_greys(self.observations))

    @cached_property
    def vignette(self) -> Vignette | None:
        """The vignette; None without a fit."""
        return None if self.fit is None else self.fit.usable_vignette(self.size)

    @cached_property
    def vignette_sigma(self) -> FloatArray | None:
        """Standard deviation of the vignette's profile at the 51 radii 0, 0.02, … 1, shape (51,)."""
        return None if self.fit is None else vignette_sigma(self.fit, self.size)
