"""The linear system of all sightings in compressed, additive form, and its solution with a prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import nnls

from ospc.arrays import FloatArray
from ospc.estimation.prior import CANDIDATES, Prior, Roughness


@dataclass(frozen=True)
class NormalEquations:
    """AᵀWA, AᵀWb and bᵀWb of a weighted linear system, and the spread of its groups' contributions.

    Attributes
    ----------
    matrix
        AᵀWA, shape (p, p).
    vector
        AᵀWb, shape (p,).
    square
        bᵀWb.
    scatter
        Σ over the groups of the outer product of their score, shape (p, p).
    tempering
        What :attr:`matrix` is multiplied by to become information: below one, as errors within a group have common
        causes and robust weights lose some.
    """

    matrix: FloatArray
    vector: FloatArray
    square: float
    scatter: FloatArray
    tempering: float = 1.0

    def tempered(self, prior_precision: FloatArray, bread: float) -> NormalEquations:
        """Return the equations with the tempering that the scatter between groups calls for.

        Parameters
        ----------
        prior_precision
            Precision of the prior, which keeps undetermined directions from having a say, shape (p, p).
        bread
            Mean derivative of the influence function over the mean weight (Huber 1981, asymptotic variance).
        """
        factor = cho_factor(self.matrix + prior_precision)
        spread = np.trace(cho_solve(factor, self.scatter)) / max(np.trace(cho_solve(factor, self.matrix)), 1e-300)
        tempering = float(bread**2 / max(spread, 1e-6))
        return NormalEquations(self.matrix, self.vector, self.square, self.scatter, tempering)

    def posterior_precision(self, prior: Prior, roughness: Roughness) -> FloatArray:
        """Return the precision of the parameters given data and prior, shape (p, p)."""
        return self.tempering * self.matrix + prior.precision(roughness)

    def best_roughness(self, prior: Prior) -> Roughness:
        """Return the roughness of the prior with the largest marginal likelihood (empirical Bayes)."""
        return max(CANDIDATES, key=lambda roughness: self._log_evidence(prior, roughness))

    def solve(self, prior: Prior, roughness: Roughness, floor: FloatArray) -> FloatArray:
        """Return the most probable parameters not below ``floor``, shape (p,): a non-negative least squares problem.

        Parameters
        ----------
        prior
            The prior.
        roughness
            Its roughness.
        floor
            Lowest value of each parameter, −inf for none, shape (p,).
        """
        precision = self.posterior_precision(prior, roughness)
        target = self._target(prior, roughness)
        free = cho_solve(cho_factor(precision), target)
        if np.all(free >= floor):
            return np.asarray(free)
        # Parameters without a floor follow from the others and are eliminated; what remains is non-negative.
        bound = np.isfinite(floor)
        inside, cross, outside = precision[~bound][:, ~bound], precision[~bound][:, bound], precision[bound][:, bound]
        factor = cho_factor(inside) if len(inside) else (inside, False)
        reduced = outside - cross.T @ cho_solve(factor, cross)
        reduced_target = target[bound] - cross.T @ cho_solve(factor, target[~bound])
        upper, low = cholesky(reduced), floor[bound]
        rest = solve_triangular(upper, reduced_target - reduced @ low, trans="T")
        found = np.empty_like(target)
        found[bound] = low + nnls(upper, rest)[0]
        found[~bound] = cho_solve(factor, target[~bound] - cross @ found[bound])
        return found

    def misfit(self, parameters: FloatArray) -> float:
        """Return the tempered weighted sum of squares left by parameters, shape (p,)."""
        square = self.square - 2 * self.vector @ parameters + parameters @ self.matrix @ parameters
        return float(self.tempering * square)

    def _target(self, prior: Prior, roughness: Roughness) -> FloatArray:
        return np.asarray(self.tempering * self.vector + prior.precision(roughness) @ prior.mean)

    def _log_evidence(self, prior: Prior, roughness: Roughness) -> float:
        precision, target = self.posterior_precision(prior, roughness), self._target(prior, roughness)
        factor = cho_factor(precision)
        mean = prior.mean
        fit = target @ cho_solve(factor, target) - mean @ prior.precision(roughness) @ mean
        log_determinant = 2 * np.sum(np.log(np.diag(factor[0])))
        return float(0.5 * (fit - log_determinant + prior.log_determinant(roughness)))
