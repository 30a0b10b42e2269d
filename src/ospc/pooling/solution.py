"""Response and vignette from the sum of the summaries' information, with the prior added once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from threadpoolctl import threadpool_limits

from ospc.arrays import FloatArray
from ospc.estimation.effects import Effects
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.model_choice import supported
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.prior import Prior
from ospc.estimation.response_basis import typical_gamma
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.pooling.summary import PARAMETERS, RESPONSE, RESPONSE_PART, VIGNETTE, Summary
from ospc.settings.estimation import MAX_GAMMA_CHANGE, MIN_GAMMA

_MOST_ROUNDS = 12
"""Most rounds of linearising the prior; a few are usual, and only information that contradicts itself takes more."""

_SETTLED = 1e-3
"""Squared change of all parameters together, in standard deviations, at which the rounds end: far below their
errors."""

_SIMPLER = (
    VignetteBasis(VIGNETTE.radial, free_centre=True),
    VignetteBasis(VIGNETTE.radial),
)


@dataclass(frozen=True)
class Information:
    """The sum of summaries: A and b of their common likelihood, and the errors that more samples do not reduce.

    Attributes
    ----------
    matrix, vector
        A and b, shapes (p, p) and (p,).
    systematic
        Sum of A S A, shape (p, p): recordings err independently of one another.
    points, groups
        Scene points and groups of them behind it.
    """

    matrix: FloatArray
    vector: FloatArray
    systematic: FloatArray
    points: int = 0
    groups: int = 0

    @classmethod
    def of(cls, summaries: Sequence[Summary]) -> Information:
        """Return the sum over summaries, which depends on their order by its last bits only."""
        nothing = np.zeros((PARAMETERS, PARAMETERS))
        return cls(
            np.sum([nothing, *(s.matrix for s in summaries)], axis=0),
            np.sum([nothing[0], *(s.vector for s in summaries)], axis=0),
            np.sum([nothing, *(s.systematic_matrix for s in summaries)], axis=0),
            sum(s.points for s in summaries),
            sum(s.groups for s in summaries),
        )

    def without(self, summary: Summary) -> Information:
        """Return what remains without one of the summaries."""
        return Information(
            self.matrix - summary.matrix,
            self.vector - summary.vector,
            self.systematic - summary.systematic_matrix,
            self.points - summary.points,
            self.groups - summary.groups,
        )

    def weakened(self, factor: float) -> Information:
        """Return the information with all variances multiplied by a factor."""
        matrix, vector, systematic = self.matrix / factor, self.vector / factor, self.systematic / factor
        return Information(matrix, vector, systematic, self.points, self.groups)


def solve(information: Information, vignette: VignetteBasis = VIGNETTE, start: Fit | None = None) -> Fit:
    """Return the most probable parameters, on one core: small matrices, which threads only slow down.

    Parameters
    ----------
    information
        What is known without the prior.
    vignette
        Model of the vignette: the common one, or it without its last parameters, which are zero then.
    start
        Solution for nearly the same information and the same model: its prior is taken, which saves most of the time.
    """
    with threadpool_limits(1, user_api="blas"):
        p = len(RESPONSE) + len(vignette)
        equations = NormalEquations(information.matrix[:p, :p], information.vector[:p], np.zeros((p, p)))
        floor = np.full(p, -np.inf)
        floor[RESPONSE_PART] = MIN_GAMMA
        parameters = np.concatenate([typical_gamma(RESPONSE.knots), np.zeros(len(vignette))])
        if start is not None:
            parameters = start.parameters
        # The prior is one of ln γ, linearised where the last round ended: a few rounds settle it.
        for _ in range(_MOST_ROUNDS):
            prior = Prior(RESPONSE.knots, parameters[RESPONSE_PART], vignette.prior_sigma)
            hyperparameters = equations.maximize_evidence(prior) if start is None else start.hyperparameters
            found = equations.solve(prior, hyperparameters, floor)
            before = parameters[RESPONSE_PART]
            found[RESPONSE_PART] = np.clip(found[RESPONSE_PART], before / MAX_GAMMA_CHANGE, before * MAX_GAMMA_CHANGE)
            change, parameters = found - parameters, found
            precision = equations.posterior_precision(prior, hyperparameters)
            if float(change @ precision @ change) < _SETTLED:
                break
        chance = cho_solve(cho_factor(precision), np.eye(p))
        covariance = chance + chance @ information.systematic[:p, :p] @ chance
        return Fit(
            RESPONSE,
            vignette,
            Effects(),
            parameters,
            covariance,
            chance,
            ErrorModel(),
            hyperparameters,
            information.points,
            information.groups,
        )


def solve_with_chosen_vignette(information: Information) -> Fit:
    """Return the most probable parameters with no more of the vignette's than the information supports."""
    fit = solve(information)
    for simpler in _SIMPLER:
        if supported(fit, len(fit.vignette_basis) - len(simpler)):
            break
        fit = solve(information, simpler)
    return fit
