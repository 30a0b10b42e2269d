"""The response in a basis of local functions: ln g is linear in the coefficients and increases if all are positive.

The basis expands the local gamma, γ(M) = d ln g / d ln M. It is constant for g = Mᵞ, 1 for a linear camera, smooth
for sRGB, logarithmic and filmic curves, and has a jump at each knee of a piecewise linear one. With hat functions Bⱼ
on knots,

    γ(M) = Σ cⱼ Bⱼ(M),     ln g(M) = −∫_M^1 γ(m)/m dm = Σ cⱼ Hⱼ(M),

so ln g is linear in c, g(0) = 0 and g(1) = 1 hold by construction, and g increases strictly if all c are positive.

To use other functions Bⱼ, write a class that implements :class:`LocalFunctions` and add it to :data:`FUNCTIONS`.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, IntArray, read_only
from ospc.errors import named
from ospc.estimation.bends import sharpest_bend
from ospc.settings.error_model import DARKEST_GREY
from ospc.settings.fit import BEND_SMOOTHING, RESOLVED_INTERVALS, UNRESOLVED_JUMP
from ospc.settings.response import (
    FIRST_GRID_STEP_BEGINS,
    QUADRATURE_POINTS,
    RESPONSE_GRID_STEPS,
    TYPICAL_GAMMA_BLACK,
    TYPICAL_GAMMA_RISE,
)

_KEPT_TABLES = 4
"""Number of bases whose tables are cached: a run uses two, and others are quickly recomputed."""


class LocalFunctions(Hashable, Protocol):
    """The functions Bⱼ of grey level whose weighted sum is the local gamma.

    The estimator and its prior rely on three properties: no function is negative, they sum to one everywhere, and
    each is one at its own knot, so that a coefficient is the local gamma at its knot. The tables are cached, so
    objects must be hashable, as all are whose class does not define equality.
    """

    def knots(self, intervals: int) -> FloatArray:
        """Return increasing grey levels from 0 to 1, shape (intervals + 1,)."""
        ...

    def values(self, grey: FloatArray, intervals: int) -> FloatArray:
        """Return all functions at grey levels in [0, 1], shape (...) -> (..., intervals + 1)."""
        ...


class Hats:
    """Hat functions on equidistant knots."""

    def knots(self, intervals: int) -> FloatArray:
        """Return the grey levels of the peaks, shape (intervals + 1,)."""
        return np.linspace(0.0, 1.0, intervals + 1)

    def values(self, grey: FloatArray, intervals: int) -> FloatArray:
        """Return all functions at grey levels in [0, 1], shape (...) -> (..., intervals + 1)."""
        at = np.asarray(grey) * intervals
        return np.asarray(np.clip(1 - np.abs(at[..., None] - np.arange(intervals + 1)), 0, None))


FUNCTIONS: dict[str, LocalFunctions] = {"hats": Hats()}
"""The available basis functions, by their name in the settings."""


@dataclass(frozen=True)
class ResponseBasis:
    """Basis functions of the local gamma, by their name in :data:`FUNCTIONS`, and their integrals for ln g.

    Raises
    ------
    SettingError
        If no functions have that name.
    """

    intervals: int
    functions: str = "hats"

    def __post_init__(self) -> None:
        """Check the name of the functions."""
        named("set of response functions", self.functions, FUNCTIONS)

    def __len__(self) -> int:
        """Return the number of coefficients."""
        return self.intervals + 1

    @property
    def resolved_intervals(self) -> int:
        """Number of intervals within which jumps of γ are not resolved."""
        return min(self.intervals, RESOLVED_INTERVALS)

    @cached_property
    def knots(self) -> FloatArray:
        """Grey levels of the knots, shape (len,)."""
        return FUNCTIONS[self.functions].knots(self.intervals)

    @cached_property
    def grid(self) -> FloatArray:
        """Fine grid of grey levels on which the functions are tabulated, shape (4097,)."""
        return _grid()

    @cached_property
    def log_table(self) -> FloatArray:
        """Hⱼ on the grid, shape (4097, len).

        ln g tends to −∞ at M = 0, so the first value is taken a quarter of a step above black, below any measurement.
        """
        return _log_table(FUNCTIONS[self.functions], self.intervals)

    def conversion(self, other: ResponseBasis) -> FloatArray:
        """Return the matrix that converts the coefficients of another basis to this one, shape (len, len of other).

        The local gamma is taken at this basis's knots.
        """
        return FUNCTIONS[other.functions].values(self.knots, other.intervals)

    def bend_of(self, coefficients: FloatArray, smoothing: float = BEND_SMOOTHING) -> FloatArray:
        """Return g″/g′ of a smoothed γ on the grid, shape (4097,).

        γ has kinks at the knots, and errors of the estimate at these would be mistaken for a bend. ``smoothing`` is a
        standard deviation in grey levels.
        """
        slope = self.smoothed_slope_of(coefficients, smoothing)
        return np.asarray(np.gradient(slope, self.grid) / slope + slope)

    def smoothed_slope_of(self, coefficients: FloatArray, smoothing: float) -> FloatArray:
        """Return the derivative of ln g for a smoothed γ, shape (4097,); ``smoothing`` as in :meth:`bend_of`."""
        gamma = _smooth_gamma_table(FUNCTIONS[self.functions], self.intervals, smoothing) @ coefficients
        return np.asarray(gamma / np.maximum(self.grid, DARKEST_GREY))

    def gamma_of(self, coefficients: FloatArray) -> FloatArray:
        """Return γ on the grid, shape (4097,)."""
        return np.asarray(_gamma_table(FUNCTIONS[self.functions], self.intervals) @ coefficients)

    def log_of(self, coefficients: FloatArray) -> FloatArray:
        """Return ln g on the grid, shape (4097,)."""
        return np.asarray(self.log_table @ coefficients)

    def smoothed_log_of(self, coefficients: FloatArray, smoothing: float) -> FloatArray:
        """Return ln g for a smoothed γ on the grid, shape (4097,); ``smoothing`` as in :meth:`bend_of`."""
        slope = self.smoothed_slope_of(coefficients, smoothing)
        steps = (slope[1:] + slope[:-1]) / 2 * np.diff(self.grid)
        return np.concatenate([-np.cumsum(steps[::-1])[::-1], [0.0]])

    def index_of(self, grey: npt.ArrayLike) -> IntArray:
        """Return the index of the grid point nearest to each grey level, never black itself, shape (n,) -> (n,)."""
        nearest = np.rint(np.asarray(grey, dtype=np.float64) * RESPONSE_GRID_STEPS)
        return np.clip(nearest, 1, RESPONSE_GRID_STEPS).astype(np.int64)

    def log_rows(self, grey: npt.ArrayLike) -> FloatArray:
        """Return Hⱼ at grey levels, shape (n,) -> (n, len)."""
        at = np.clip(np.asarray(grey, dtype=np.float64), 0, 1) * RESPONSE_GRID_STEPS
        lower = np.minimum(at.astype(np.int64), RESPONSE_GRID_STEPS - 1)
        part = (at - lower)[:, None]
        return np.asarray(self.log_table[lower] * (1 - part) + self.log_table[lower + 1] * part)

    def unresolved(self, coefficients: FloatArray, grey: FloatArray) -> FloatArray:
        """Return the standard deviation of ln g due to jumps of γ within intervals between knots, shape (n,).

        The possible size of a jump is estimated from the largest bend of the fitted γ at the surrounding knots. Knots
        closer than 1/:data:`~ospc.settings.fit.RESOLVED_INTERVALS` do not resolve more.
        """
        functions = FUNCTIONS[self.functions]
        knots = functions.knots(self.resolved_intervals)
        sharpest = sharpest_bend(functions.values(knots, self.intervals) @ coefficients, knots, grey)
        width = np.interp(grey, knots[1:], np.diff(knots))
        return np.asarray(UNRESOLVED_JUMP * sharpest * width / np.maximum(grey, width))


# Equal bases share their tables: computing them takes as long as a round of a small fit.


@cache
def _grid() -> FloatArray:
    return read_only(np.linspace(0.0, 1.0, RESPONSE_GRID_STEPS + 1))


@lru_cache(maxsize=_KEPT_TABLES)
def _gamma_table(functions: LocalFunctions, intervals: int) -> FloatArray:
    return read_only(functions.values(_grid(), intervals))


@lru_cache(maxsize=_KEPT_TABLES)
def _log_table(functions: LocalFunctions, intervals: int) -> FloatArray:
    edges = np.concatenate([[FIRST_GRID_STEP_BEGINS / RESPONSE_GRID_STEPS], _grid()[1:]])
    # Gauss–Legendre quadrature on each step in ln m: the 1/m drops out and the integrand is the function.
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    log_edges = np.log(edges)
    half = np.diff(log_edges)[:, None] / 2
    places = np.exp((log_edges[:-1] + log_edges[1:])[:, None] / 2 + half * nodes)
    values = (functions.values(place, intervals) for place in places.T)
    steps = half * sum(weight * value for weight, value in zip(weights, values, strict=True))
    table = np.zeros((RESPONSE_GRID_STEPS + 1, intervals + 1))
    table[:-1] = -steps[::-1].cumsum(axis=0)[::-1]
    return read_only(table)


@lru_cache(maxsize=2 * _KEPT_TABLES)
def _smooth_gamma_table(functions: LocalFunctions, intervals: int, smoothing: float) -> FloatArray:
    """Return the smoothed functions on the grid, shape (4097, len)."""
    # A smoothed γ is a sum of smoothed functions, so this is computed once per basis rather than for every response.
    # The window is wide, so Fourier transforms take a tenth of the time.
    sigma = smoothing * RESPONSE_GRID_STEPS
    half_width = round(4 * sigma)
    window = np.exp(-0.5 * (np.arange(-half_width, half_width + 1) / sigma) ** 2)
    continued = np.pad(_gamma_table(functions, intervals), ((half_width, half_width), (0, 0)), mode="edge")
    spectrum = np.fft.rfft(continued, axis=0) * np.fft.rfft(window / window.sum(), len(continued))[:, None]
    return read_only(np.fft.irfft(spectrum, len(continued), axis=0)[2 * half_width :])


def typical_gamma(grey: npt.ArrayLike) -> FloatArray:
    """Return a typical local gamma at grey levels in [0, 1].

    This is a straight line through the medians over 201 measured responses of films and cameras (Grossberg and Nayar
    2003, database of response functions) up to grey level 0.8. Above, cameras differ too much for a median to be
    useful.
    """
    return np.asarray(TYPICAL_GAMMA_BLACK + TYPICAL_GAMMA_RISE * np.asarray(grey, dtype=np.float64))
