"""The data behind a calibration: exposure ratios of pairs, and tables of the observations and their residuals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ospc.arrays import ByValue, FloatArray, IntArray
from ospc.errors import FormatError
from ospc.numerics.robust import weighted_median
from ospc.photometry.grey_range import FULL_RANGE, GreyRange


@dataclass(frozen=True, eq=False)
class ExposureRatios(ByValue):
    """Exposure ratios of pairs of frames, estimated (paper, eq. mean) and from the metadata."""

    frames: IntArray
    """Indices of the two frames of each pair, shape (pairs, 2)."""
    metadata: FloatArray
    """k = e₀/e₁ from the exposures of the recording, shape (pairs,)."""
    estimated: FloatArray
    """k from grey values, response and vignette, shape (pairs,)."""
    samples: IntArray
    """Number of correspondences behind each estimate, shape (pairs,)."""
    log_sigma: FloatArray | None = None
    """Standard deviation of ln of each estimate, shape (pairs,); None if the method does not provide it."""

    @classmethod
    def none(cls) -> ExposureRatios:
        """Return an empty table."""
        empty = np.empty(0)
        return cls(np.empty((0, 2), np.int64), empty, empty, np.empty(0, np.int64))

    @property
    def log_residual(self) -> FloatArray:
        """ln(estimated / metadata), shape (pairs,)."""
        return np.log(self.estimated / self.metadata)

    @property
    def misfit(self) -> float:
        """Median of the absolute log residual, weighted by the number of samples; NaN without pairs."""
        return weighted_median(np.abs(self.log_residual), self.samples)

    @property
    def bias(self) -> float:
        """Median of the log residual times the sign of ln k, weighted by the number of samples; NaN without pairs.

        It is positive if exposure changes are larger than in the metadata.
        """
        return weighted_median(self.log_residual * np.sign(np.log(self.metadata)), self.samples)


QUANTILES = (0.16, 0.5, 0.84)
"""Quantiles of the residuals: the median and the limits of the central 68 per cent, ±1σ of a normal distribution."""
_FEW_OBSERVATIONS = 30
"""A class of grey levels or radii with fewer observations counts as not covered: 1 % of a typical class."""
_RESIDUALS = ("residual_by_grey", "residual_by_radius", "residual_by_place")

_MAX_CLASSES = 128
"""Maximum number of classes along an axis of a table, which limits the memory that a damaged file can require."""


@dataclass(frozen=True, eq=False)
class Coverage(ByValue):
    """Counts and residuals of observations; an observation is one scene point in one frame.

    A residual is ln(g(M) / (e·V)) of an observation minus its mean over the point: 0.01 is one per cent of the
    radiance. Residuals are NaN in classes with too few observations, and None without a calibration.
    """

    exposure_edges_ms: FloatArray
    """Limits of the classes of exposure, shape (exposures + 1,)."""
    grey_exposure: IntArray
    """Number of observations by class of exposure and by grey level, in equal classes from 0 to 1, shape
    (exposures, greys)."""
    radius_radius: IntArray
    """Number of observations by the radius of the point in the first and in the second frame, in equal classes from
    the centre to the corner, shape (radii, radii)."""
    residual_by_grey: FloatArray | None = None
    """:data:`QUANTILES` of the residuals in each class of grey levels, shape (greys, 3)."""
    residual_by_radius: FloatArray | None = None
    """:data:`QUANTILES` of the residuals in each class of radii, shape (radii, 3)."""
    residual_by_place: FloatArray | None = None
    """Median residual in equal cells of the image, shape (rows, columns)."""

    @property
    def by_grey(self) -> IntArray:
        """Observations by grey level, shape (greys,)."""
        return np.asarray(self.grey_exposure.sum(axis=0))

    @property
    def by_radius(self) -> IntArray:
        """Observations by radius, shape (radii,)."""
        return np.asarray(self.radius_radius.sum(axis=0))

    def gaps(self, max_grey: int, grey_range: GreyRange = FULL_RANGE) -> tuple[str, ...]:
        """Return one phrase for each gap in the coverage between black and white, which also says how to fill it."""
        middle = (np.arange(len(self.by_grey)) + 0.5) / len(self.by_grey)
        inside = (middle > grey_range.black) & (middle < grey_range.white)
        by_grey = np.where(inside, self.by_grey, _FEW_OBSERVATIONS)
        greys = ", ".join(f"{a * max_grey:.0f}–{b * max_grey:.0f}" for a, b in _uncovered(by_grey))
        radii = ", ".join(f"{a:.2f}–{b:.2f}" for a, b in _uncovered(self.by_radius))
        film_greys = (
            f"few observations have grey levels {greys}: record uniform surfaces of this brightness at several "
            "exposures"
        )
        film_radii = f"few observations are at radii {radii} (1 = corner): move uniform surfaces through them"
        return tuple(advice for advice, ranges in ((film_greys, greys), (film_radii, radii)) if ranges)

    def as_dict(self) -> dict[str, Any]:
        """Return all tables as JSON-compatible values; NaN becomes None."""
        counted = ("exposure_edges_ms", "grey_exposure", "radius_radius")
        return {
            **{name: getattr(self, name).tolist() for name in counted},
            "residual_quantiles": list(QUANTILES),
            **{name: _listed(getattr(self, name)) for name in _RESIDUALS},
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Coverage:
        """Return the tables from the output of :meth:`as_dict`; FormatError if they are inconsistent."""
        edges = np.array(content["exposure_edges_ms"], dtype=np.float64, ndmin=1)
        grey_exposure = np.array(content["grey_exposure"], dtype=np.int64, ndmin=1)
        radius_radius = np.array(content["radius_radius"], dtype=np.int64, ndmin=1)
        by_grey, by_radius, by_place = (
            None if content[name] is None else np.array(content[name], dtype=np.float64) for name in _RESIDUALS
        )
        exposures, greys, radii = len(edges) - 1, grey_exposure.shape[-1], len(radius_radius)
        by_quantile = ((by_grey, (greys, len(QUANTILES))), (by_radius, (radii, len(QUANTILES))))
        counts = ((grey_exposure, (exposures, greys)), (radius_radius, (radii, radii)))
        fit = all(table is None or table.shape == shape for table, shape in (*counts, *by_quantile))
        if not fit or edges.ndim != 1 or (by_place is not None and by_place.ndim != 2):
            raise FormatError("the tables of the coverage have inconsistent shapes")
        if max(*grey_exposure.shape, radii) > _MAX_CLASSES:
            raise FormatError("the tables of the coverage are too large")
        if not np.all(np.isfinite(edges)) or any(table.min(initial=0) < 0 for table, _ in counts):
            raise FormatError("the tables of the coverage contain negative counts or infinite exposures")
        return cls(edges, grey_exposure, radius_radius, by_grey, by_radius, by_place)


def _uncovered(counts: IntArray) -> list[tuple[float, float]]:
    """Return the ranges with few observations, as fractions of the whole range."""
    edges = np.flatnonzero(np.diff(counts < _FEW_OBSERVATIONS, prepend=False, append=False)) / len(counts)
    return [(float(low), float(high)) for low, high in edges.reshape(-1, 2)]


def _listed(values: FloatArray | None) -> list[Any] | None:
    if values is None:
        return None
    return [[cell if math.isfinite(cell) else None for cell in row] for row in values.tolist()]
