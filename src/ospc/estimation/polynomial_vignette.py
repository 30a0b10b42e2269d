"""The paper's vignette: a radial polynomial fitted to ratios of irradiance (paper, eqs. radial and martix_v)."""

from __future__ import annotations

from functools import partial

import numpy as np

from ospc.arrays import FloatArray
from ospc.correspondence.correspondences import Correspondences
from ospc.errors import SettingError
from ospc.estimation.robust import (
    WeightFunction,
    absolute_weights,
    huber_weights,
    reweighted_least_squares,
    uniform_weights,
)
from ospc.photometry.response import Response

DEGREE = 3
"""Terms R², R⁴ and R⁶ of the paper's vignette (paper, eq. radial)."""


def vignette_rows(pairs: Correspondences, response: Response) -> tuple[FloatArray, FloatArray]:
    """Return the rows [R₀²−ψR₁², R₀⁴−ψR₁⁴, R₀⁶−ψR₁⁶] and the right-hand sides ψ−1, with ψ = g(M₀)/g(M₁)/k.

    Returns
    -------
    tuple of FloatArray
        Shapes (n, 3) and (n,).
    """
    psi = response.inverse(pairs.grey0) / response.inverse(pairs.grey1) / pairs.exposure_ratio
    powers = 2 * np.arange(1, DEGREE + 1)
    rows = pairs.radius0[:, None] ** powers - psi[:, None] * pairs.radius1[:, None] ** powers
    return np.asarray(rows), np.asarray(psi - 1)


def vignette_solver(name: str, tuning: float = 1.345) -> WeightFunction:
    """Return the weights of the solver called "l2", "l1" or "m-estimator" (paper, section 5).

    Raises
    ------
    SettingError
        If there is none of that name.
    """
    solvers: dict[str, WeightFunction] = {
        "l2": uniform_weights,
        "l1": absolute_weights,
        "m-estimator": partial(huber_weights, tuning=tuning),
    }
    if name not in solvers:
        raise SettingError(f"no vignette solver is called '{name}'; known: {', '.join(solvers)}")
    return solvers[name]


def solve_vignette(rows: FloatArray, target: FloatArray, weights: WeightFunction) -> FloatArray:
    """Return (v₁, v₂, v₃), shape (3,), from the rows and right-hand sides of :func:`vignette_rows`."""
    return reweighted_least_squares(rows, target, weights)
