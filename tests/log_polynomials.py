"""Vignettes whose logarithm is a polynomial of R²."""

from __future__ import annotations

import math

import numpy as np

from ospc.arrays import ImageSize
from ospc.photometry.radial_spline import radial_spline
from ospc.photometry.vignette import LogSplineVignette

REACH = 2.0
"""Radius, in half diagonals, up to which the spline follows the polynomial: all of any image, about any centre."""

MANY_KNOTS = 400
"""Number of knots for which a spline differs from a polynomial of a high degree by about 1e-6."""


def log_polynomial(
    size: ImageSize,
    coefficients: tuple[float, ...],
    centre: tuple[float, float] = (0.0, 0.0),
    non_radial: tuple[float, ...] = (),
    limit: float = math.inf,
) -> LogSplineVignette:
    """Return the vignette ln V = a₁R² + a₂R⁴ + … plus non-radial terms; exact for two coefficients at most."""
    spline = radial_spline(2 if len(coefficients) <= 2 else MANY_KNOTS, REACH)
    slopes = np.polynomial.polynomial.polyval(
        spline.knots, [number * a for number, a in enumerate(coefficients, start=1)]
    )
    return LogSplineVignette(size, tuple(slopes.tolist()), centre, non_radial, limit, REACH)
