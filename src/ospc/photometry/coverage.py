"""What the measurements behind a calibration cover, and how far they are from it: a few small tables."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, IntArray
from ospc.errors import FormatError

QUANTILES = (0.16, 0.5, 0.84)
"""Of the residuals: the middle, and where two thirds of them end."""

_MOST_CELLS = 128


@dataclass(frozen=True)
class Coverage:
    """Counts and residuals of observations, each of one scene point in one frame.

    Residuals are those of ln(g(M) / (e·V)) at an observation, against the mean over its point: 0.01 is
    one per cent of irradiance.

    Attributes
    ----------
    exposure_edges_ms
        Limits of the classes of exposure, shape (exposures + 1,).
    grey_exposure
        Observations by class of exposure and by grey level, in equal classes from 0 to 1, shape (exposures, greys).
    radius_radius
        Observations by radius of the point where it was seen before and where it is seen now, in equal classes from
        centre to corner, shape (radii, radii).
    residual_by_grey, residual_by_radius
        :data:`QUANTILES` of the residuals in each class, shapes (greys, 3) and (radii, 3); NaN where too few are.
        None where there is no calibration to measure them by.
    residual_by_place
        Their median in equal cells of the image, shape (rows, columns); NaN where too few are.
    """

    exposure_edges_ms: FloatArray
    grey_exposure: IntArray
    radius_radius: IntArray
    residual_by_grey: FloatArray | None = None
    residual_by_radius: FloatArray | None = None
    residual_by_place: FloatArray | None = None

    @property
    def by_grey(self) -> IntArray:
        """Observations by grey level, shape (greys,)."""
        return np.asarray(self.grey_exposure.sum(axis=0))

    @property
    def by_radius(self) -> IntArray:
        """Observations by radius, shape (radii,)."""
        return np.asarray(self.radius_radius.sum(axis=0))

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON-compatible values; NaN is None."""
        return {
            "exposure_edges_ms": self.exposure_edges_ms.tolist(),
            "grey_exposure": self.grey_exposure.tolist(),
            "radius_radius": self.radius_radius.tolist(),
            "residual_quantiles": list(QUANTILES),
            "residual_by_grey": _listed(self.residual_by_grey),
            "residual_by_radius": _listed(self.residual_by_radius),
            "residual_by_place": _listed(self.residual_by_place),
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Coverage:
        """Return what :meth:`as_dict` wrote.

        Raises
        ------
        FormatError
            If the tables are not of shapes that fit together.
        """
        edges = np.array(content["exposure_edges_ms"], dtype=np.float64)
        grey_exposure = np.array(content["grey_exposure"], dtype=np.int64)
        radius_radius = np.array(content["radius_radius"], dtype=np.int64)
        by_grey, by_radius, by_place = (
            None if content[name] is None else np.array(content[name], dtype=np.float64)
            for name in ("residual_by_grey", "residual_by_radius", "residual_by_place")
        )
        if grey_exposure.ndim != 2 or radius_radius.ndim != 2 or edges.shape != (len(grey_exposure) + 1,):
            raise FormatError("the tables of the coverage do not fit together")
        greys, radii = grey_exposure.shape[1], len(radius_radius)
        _check_shape(radius_radius, (radii, radii))
        _check_shape(by_grey, (greys, len(QUANTILES)))
        _check_shape(by_radius, (radii, len(QUANTILES)))
        if not np.all(np.isfinite(edges)) or grey_exposure.min(initial=0) < 0 or radius_radius.min(initial=0) < 0:
            raise FormatError("the tables of the coverage hold negative counts or infinite exposures")
        if max(*grey_exposure.shape, radii) > _MOST_CELLS or (by_place is not None and by_place.ndim != 2):
            raise FormatError("the tables of the coverage are too large")
        return cls(edges, grey_exposure, radius_radius, by_grey, by_radius, by_place)


def _listed(values: FloatArray | None) -> list[Any] | None:
    if values is None:
        return None
    return [[round(cell, 6) if math.isfinite(cell) else None for cell in row] for row in values.tolist()]


def _check_shape(values: npt.NDArray[Any] | None, shape: tuple[int, ...]) -> None:
    if values is not None and values.shape != shape:
        raise FormatError(f"a table of the coverage has shape {values.shape} instead of {shape}")
