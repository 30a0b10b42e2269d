"""The paper's response: a polynomial by equality-constrained least squares (paper, eqs. poly_div to final_form)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.optimize import nnls

from ospc.arrays import FloatArray
from ospc.correspondence.correspondences import Correspondences
from ospc.photometry.response import Response

Positivity = Literal["never", "when needed", "always"]


def response_rows(pairs: Correspondences, degree: int = 2) -> FloatArray:
    """Return the rows [1−k, M₀−kM₁, …, M₀ᵈ−kM₁ᵈ] of the homogeneous system A c = 0 (paper, eq. matrix_form).

    Returns
    -------
    FloatArray
        Shape (n, degree + 1).
    """
    powers = np.arange(degree + 1)
    return np.asarray(pairs.grey0[:, None] ** powers - pairs.exposure_ratio * pairs.grey1[:, None] ** powers)


def solve_kkt(gram: FloatArray) -> FloatArray:
    """Minimise cᵀ(AᵀA)c subject to Σc = 1 and c₀ = 0 through the KKT system's pseudo-inverse (paper, eq. final_form).

    Parameters
    ----------
    gram
        AᵀA, shape (d+1, d+1).

    Returns
    -------
    FloatArray
        Coefficients c₀ … c_d, shape (d+1,).
    """
    n = len(gram)
    constraints = np.zeros((2, n))
    constraints[0] = 1
    constraints[1, 0] = 1
    # The constraints do not scale with the number of rows; the Gram matrix must not either, for the sake of pinv.
    scaled = gram / max(float(np.trace(gram)), np.finfo(float).tiny)
    system = np.block([[2 * scaled, constraints.T], [constraints, np.zeros((2, 2))]])
    target = np.concatenate([np.zeros(n), [1.0, 0.0]])
    return np.asarray(np.linalg.pinv(system, hermitian=True) @ target)[:n]


def solve_nonnegative(gram: FloatArray) -> FloatArray:
    """Minimise cᵀ(AᵀA)c subject to Σc = 1, c₀ = 0 and c ≥ 0, as the authors' released program does.

    Parameters
    ----------
    gram
        AᵀA, shape (d+1, d+1).

    Returns
    -------
    FloatArray
        Coefficients, shape (d+1,); their sum is one exactly.
    """
    n = len(gram)
    scale, vectors = np.linalg.eigh(gram / max(float(np.trace(gram)), np.finfo(float).tiny))
    root = np.sqrt(np.clip(scale, 0, None))[:, None] * vectors.T
    # One heavy row asks for Σc = 1; what it leaves undone is divided out.
    heavy = 1e4
    solution, _ = nnls(np.vstack([root[:, 1:], np.full((1, n - 1), heavy)]), np.append(np.zeros(n), heavy))
    return np.concatenate([[0.0], solution / solution.sum()])


def increases(coefficients: FloatArray, levels: int = 1024) -> bool:
    """Tell whether the polynomial increases strictly over [0, 1]."""
    values = np.polynomial.polynomial.polyval(np.linspace(0, 1, levels), coefficients)
    return bool(np.all(np.diff(values) > 0))


def solve_response(gram: FloatArray, positivity: Positivity) -> FloatArray | None:
    """Return the coefficients of g, or None where the solution does not increase and may not be constrained.

    Parameters
    ----------
    gram
        AᵀA, shape (d+1, d+1).
    positivity
        When to ask for c ≥ 0.
    """
    coefficients = solve_nonnegative(gram) if positivity == "always" else solve_kkt(gram)
    if not increases(coefficients) and positivity == "when needed":
        coefficients = solve_nonnegative(gram)
    return coefficients if increases(coefficients) else None


def polynomial_response(coefficients: FloatArray, sigma: FloatArray | None, support: tuple[float, float]) -> Response:
    """Return the response whose inverse is the polynomial, at 256 levels.

    Parameters
    ----------
    coefficients
        c₀ … c_d, shape (d+1,), with Σc = 1 and c₀ = 0.
    sigma
        Standard deviation of g at the 256 levels; None where unknown.
    support
        Lowest and highest grey level among the samples.
    """
    levels = np.linspace(0, 1, 256)
    table = np.polynomial.polynomial.polyval(levels, coefficients)
    return Response.from_values(
        table,
        inverse_sigma=sigma,
        support=support,
        model={"name": "polynomial", "coefficients": coefficients.tolist()},
    )
