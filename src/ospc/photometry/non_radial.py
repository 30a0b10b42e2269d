"""The terms of ln V that depend on the direction: a tilt and an ellipse, and both growing outwards."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ospc.arrays import FloatArray


class NonRadialTerm(NamedTuple):
    """A term, a polynomial of the position (x, y) relative to the centre of the vignette, and its derivatives."""

    degree: int
    value: Callable[[FloatArray, FloatArray], FloatArray]
    by_x: Callable[[FloatArray, FloatArray], FloatArray]
    by_y: Callable[[FloatArray, FloatArray], FloatArray]


_TERMS = {
    "x": NonRadialTerm(1, lambda x, _: x, lambda x, _: np.ones_like(x), lambda x, _: np.zeros_like(x)),
    "y": NonRadialTerm(1, lambda _, y: y, lambda _, y: np.zeros_like(y), lambda _, y: np.ones_like(y)),
    "xy": NonRadialTerm(2, lambda x, y: x * y, lambda _, y: y, lambda x, _: x),
    "x2-y2": NonRadialTerm(2, lambda x, y: x**2 - y**2, lambda x, _: 2 * x, lambda _, y: -2 * y),
    "xR2": NonRadialTerm(3, lambda x, y: x * (x**2 + y**2), lambda x, y: 3 * x**2 + y**2, lambda x, y: 2 * x * y),
    "yR2": NonRadialTerm(3, lambda x, y: y * (x**2 + y**2), lambda x, y: 2 * x * y, lambda x, y: x**2 + 3 * y**2),
    "xyR2": NonRadialTerm(
        4,
        lambda x, y: x * y * (x**2 + y**2),
        lambda x, y: y * (3 * x**2 + y**2),
        lambda x, y: x * (x**2 + 3 * y**2),
    ),
    "(x2-y2)R2": NonRadialTerm(
        4, lambda x, y: (x**2 - y**2) * (x**2 + y**2), lambda x, _: 4 * x**3, lambda _, y: -4 * y**3
    ),
}
"""The terms by name, with R² = x² + y²."""
NON_RADIAL = tuple(_TERMS)
"""Names of the terms."""
DEGREES = tuple(term.degree for term in _TERMS.values())
"""Degrees of the terms in x and y."""


def non_radial_terms(x: FloatArray, y: FloatArray) -> list[FloatArray]:
    """Return the terms at positions relative to the centre of the vignette; x and y broadcast."""
    return [term.value(x, y) for term in _TERMS.values()]


def slope_of_non_radial(coefficients: FloatArray, position: FloatArray) -> FloatArray:
    """Return the gradient of the sum of the terms, times coefficients, at positions, shape (n, 2) -> (n, 2)."""
    x, y = position.T
    slope = np.zeros_like(position)
    for coefficient, term in zip(coefficients, _TERMS.values(), strict=True):
        slope[:, 0] += coefficient * term.by_x(x, y)
        slope[:, 1] += coefficient * term.by_y(x, y)
    return slope
