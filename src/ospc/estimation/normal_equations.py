"""The normal equations of all observations, and their solution with a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.prior import Prior, PriorHyperparameters, jumps_of_knees
from ospc.estimation.shared_errors import SharedErrors
from ospc.numerics.least_squares import non_negative_least_squares
from ospc.numerics.symmetric import eigh, variances
from ospc.settings.fit import DISAGREEMENT_SHARE, MIN_DETERMINED_PARAMETERS, MIN_SCORE_SPREAD
from ospc.settings.response import KNEE_EVIDENCE, MAX_KNEES


@dataclass(frozen=True)
class NormalEquations:
    """AᵀWA and AᵀWb of a weighted linear system, and the scatter of its groups' scores."""

    matrix: FloatArray
    """AᵀWA, shape (p, p)."""
    vector: FloatArray
    """AᵀWb, shape (p,)."""
    scatter: FloatArray
    """Sum over the blocks of groups of the outer product of their scores, shape (p, p)."""
    information_scale: float = 1.0
    """Factor that converts :attr:`matrix` to information. It is below one because errors within a group share causes
    and because robust weights discard information."""
    sandwich_factor: float = 1.0
    """Mean derivative of the influence function over the mean weight (Huber 1981, asymptotic variance)."""
    blocks: int = 1
    """Number of blocks."""

    def centred(self, about: FloatArray) -> NormalEquations:
        """Return the equations with the scatter about the mean score instead of zero.

        The mean score is zero at the solution, except in the direction of a parameter that is left out: there it
        indicates that the parameter is missing and is not scatter. The scores were taken at ``about``, shape (p,).
        """
        total = self.vector - self.matrix @ about
        return replace(self, scatter=self.scatter - np.outer(total, total) / self.blocks)

    def part(self, chosen: IntArray) -> NormalEquations:
        """Return the unscaled equations of chosen parameters, with the others fixed at zero."""
        block = np.ix_(chosen, chosen)
        return replace(self, matrix=self.matrix[block], vector=self.vector[chosen], scatter=self.scatter[block])

    def without_last(self, precision: FloatArray) -> NormalEquations:
        """Return scaled equations with the last parameters, of a prior precision about zero, (k, k), marginalised."""
        n, scale = len(self.vector) - len(precision), self.information_scale
        inner = scale * self.matrix[n:, n:] + precision
        carried = np.linalg.solve(inner, scale * self.matrix[n:, :n])
        matrix = self.matrix[:n, :n] - self.matrix[:n, n:] @ carried
        vector = self.vector[:n] - carried.T @ self.vector[n:]
        return replace(self, matrix=matrix, vector=vector, scatter=self.scatter[:n, :n])

    def last_fitted(self, precision: FloatArray, mean: FloatArray, own_precision: float, own_mean: float) -> float:
        """Return the last parameter, fitted jointly with all others.

        The others have a prior with the given precision, shape (p − 1, p − 1), and mean, (p − 1,); the last one has
        its own. Precisions are in units of :attr:`matrix`.
        """
        column = self.matrix[:-1, -1]
        carried = np.linalg.solve(self.matrix[:-1, :-1] + precision, column)
        seen = self.matrix[-1, -1] - column @ carried
        value = self.vector[-1] - carried @ (self.vector[:-1] + precision @ mean)
        return float((value + own_precision * own_mean) / (seen + own_precision))

    def scaled(self, prior_precision: FloatArray, sandwich_factor: float) -> NormalEquations:
        """Return the equations with the information scale that follows from the scatter between groups.

        The precision of the prior, shape (p, p), gives little weight to directions that the data do not determine.
        """
        # At the solution the scores add up to zero, so a single block shows no scatter.
        scatter = self.matrix if self.blocks == 1 else self.scatter * self.blocks / (self.blocks - 1)
        inverse = np.linalg.inv(self.matrix + prior_precision)
        # All are symmetric. The divisor is the number of parameters that the data determine.
        spread = np.sum(inverse * scatter) / max(np.sum(inverse * self.matrix), MIN_DETERMINED_PARAMETERS)
        scale = float(sandwich_factor**2 / max(spread, MIN_SCORE_SPREAD))
        return replace(self, scatter=scatter, information_scale=scale, sandwich_factor=sandwich_factor)

    def newton_step(self, prior_precision: FloatArray, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the most probable parameters without limits, (p,), and their covariance due to chance, (p, p).

        Precision, shape (p, p), and mean, (p,), are those of the prior. The information scale is computed anew.
        """
        scaled = self.scaled(prior_precision, self.sandwich_factor)
        whole = scaled.information_scale * scaled.matrix + prior_precision
        covariance = np.asarray(np.linalg.inv(whole), dtype=np.float64)
        return covariance @ (scaled.information_scale * scaled.vector + prior_precision @ mean), covariance

    def posterior_precision(self, prior: Prior, hyperparameters: PriorHyperparameters) -> FloatArray:
        """Return the precision of the parameters given data and prior, shape (p, p)."""
        return self.information_scale * self.matrix + prior.precision(hyperparameters)

    def covariance(self, prior: Prior, hyperparameters: PriorHyperparameters, shared: SharedErrors) -> FloatArray:
        """Return the covariance of the most probable parameters about the truth, shape (p, p).

        This is the sandwich estimator of Huber (1967): in each direction, it derives the variance of the parameters
        from the scatter of the scores rather than from the assumed errors. Errors that all groups share are added:
        the excess over chance of the disagreement between halves, and the expected errors.
        """
        bread = np.asarray(np.linalg.inv(self.posterior_precision(prior, hyperparameters)), dtype=np.float64)
        # The information scale is the sandwich factor squared over the spread of the scatter.
        scale = self.information_scale / self.sandwich_factor
        halves, expected = scale * shared.disagreement, self.information_scale * shared.expected
        by_chance = self.information_scale * np.sum(bread * self.matrix)
        squared = variances(halves, bread)
        share = DISAGREEMENT_SHARE * np.maximum(1 - by_chance / np.maximum(squared, 1e-300), 0.0)
        meat = scale**2 * self.scatter + (halves.T * share) @ halves + expected.T @ expected
        found = bread @ (meat + prior.precision(hyperparameters)) @ bread
        return np.asarray((found + found.T) / 2)  # symmetric but for rounding

    def maximize_evidence(
        self, prior: Prior, present: PriorHyperparameters, knee_evidence: float = KNEE_EVIDENCE
    ) -> PriorHyperparameters:
        """Return the hyperparameters of the prior with the largest marginal likelihood (empirical Bayes).

        Those of the response are chosen first, with the present one of the vignette. Each of its knees has to raise
        the logarithm of the marginal likelihood by ``knee_evidence``.
        """
        # There are many candidates for the response, so all other parameters are eliminated first.
        others = prior.precision(present)[len(prior.response) :, len(prior.response) :]
        alone, of_response = self.without_last(others), prior.of_response
        response = alone._most_probable(of_response, replace(present, knees=()).response_candidates)
        while (further := alone._with_another_knee(of_response, response, knee_evidence)) != response:
            response = further
        return self._most_probable(prior, response.vignette_candidates) if prior.vignette.radial else response

    def _with_another_knee(
        self, prior: Prior, present: PriorHyperparameters, least_gain: float
    ) -> PriorHyperparameters:
        """Return the present hyperparameters, or the most probable ones with one more knee if that gains enough."""
        # Between its knees, a response is smooth, so the roughest candidates are left out.
        candidates = [present, *present.smooth_candidates]
        evidence = self.log_evidence(prior, candidates)
        gains = evidence[:, None] - evidence[0] + self.log_evidence_of_knees(prior, candidates)
        gains[:, np.array(present.knees, np.int64) - 1] = -np.inf
        _, knee = np.unravel_index(np.argmax(gains), gains.shape)
        if gains.max() < least_gain or len(present.knees) == MAX_KNEES:
            return present
        knees = tuple(sorted((*present.knees, int(knee) + 1)))
        return self._most_probable(prior, replace(present, knees=knees).response_candidates)

    def log_evidence_of_knees(self, prior: Prior, candidates: list[PriorHyperparameters]) -> FloatArray:
        """Return by how much a knee at each inner knot raises :meth:`log_evidence`, shape (c, knots − 2).

        The prior is that of the response alone.
        """
        jumps = prior.about * jumps_of_knees(prior.response.knots)[1:-1]
        of_prior, _ = prior.of_candidates(candidates)
        matrix = self.information_scale * self.matrix
        excess = self.information_scale * self.vector - matrix @ prior.mean
        solved = np.linalg.solve(of_prior + matrix, np.column_stack([matrix, excess]))
        # A − A (A + P)⁻¹ A: the inverse covariance of the data, which contain the deviation from the prior's mean.
        inverse = matrix - matrix @ solved[:, :, :-1]
        along = np.einsum("kia,ca->cki", jumps, excess - solved[:, :, -1] @ matrix)
        widened = np.eye(2) + np.einsum("kia,cab,kjb->ckij", jumps, inverse, jumps, optimize=True)
        explained = np.sum(along * np.linalg.solve(widened, along[..., None])[..., 0], axis=-1)
        return np.asarray((explained - np.linalg.slogdet(widened)[1]) / 2)

    def _most_probable(self, prior: Prior, candidates: list[PriorHyperparameters]) -> PriorHyperparameters:
        """Return the candidate with the largest marginal likelihood."""
        return candidates[int(np.argmax(self.log_evidence(prior, candidates)))]

    def log_evidence(self, prior: Prior, candidates: list[PriorHyperparameters]) -> FloatArray:
        """Return the logarithm of the marginal likelihood of each candidate up to a constant, shape (c,)."""
        mean = prior.mean
        # All candidates at once: a loop over small matrices takes several times as long.
        of_prior, log_determinant_of_prior = prior.of_candidates(candidates)
        precision = self.information_scale * self.matrix + of_prior
        target = self.information_scale * self.vector + of_prior @ mean
        factor = np.linalg.cholesky(precision)
        solution = np.linalg.solve(precision, target[:, :, None])[:, :, 0]
        fit = np.sum(target * solution, axis=1) - of_prior @ mean @ mean
        log_determinant = 2 * np.sum(np.log(np.diagonal(factor, axis1=1, axis2=2)), axis=1)
        return np.asarray((fit - log_determinant + log_determinant_of_prior) / 2)

    def solve(self, prior: Prior, hyperparameters: PriorHyperparameters, floor: FloatArray) -> FloatArray:
        """Return the most probable parameters, shape (p,), by non-negative least squares.

        ``floor``, shape (p,), is the lower limit of each parameter, −inf for none.
        """
        precision = self.posterior_precision(prior, hyperparameters)
        target = np.asarray(self.information_scale * self.vector + prior.precision(hyperparameters) @ prior.mean)
        free = np.linalg.solve(precision, target)
        if np.all(free >= floor):
            return np.asarray(free)
        # Eliminate the parameters without a floor; the rest, minus their floors, is a non-negative problem.
        bound = np.isfinite(floor)
        inside, cross, outside = precision[~bound][:, ~bound], precision[~bound][:, bound], precision[bound][:, bound]
        carried, low = np.linalg.solve(inside, cross), floor[bound]
        reduced = outside - cross.T @ carried
        reduced_target = target[bound] - carried.T @ target[~bound]
        lower = np.asarray(np.linalg.cholesky(reduced), dtype=np.float64)
        rest = np.asarray(np.linalg.solve(lower, reduced_target - reduced @ low), dtype=np.float64)
        found = np.empty_like(target)
        found[bound] = low + non_negative_least_squares(lower.T, rest)
        found[~bound] = np.linalg.solve(inside, target[~bound] - cross @ found[bound])
        return found


def at_least(covariance: FloatArray, precision: FloatArray) -> FloatArray:
    """Return a covariance, shape (p, p), widened where it is smaller than the inverse of a precision."""
    lower = np.linalg.cholesky(precision)
    ratio, directions = eigh(lower.T @ covariance @ lower)
    across = np.linalg.solve(lower.T, directions)
    return np.asarray((across * np.maximum(ratio, 1.0)) @ across.T)
