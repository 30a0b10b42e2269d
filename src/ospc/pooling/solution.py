"""Solve for response and vignette from summed summaries, with the prior added once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.effects import Effects
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.model import Model
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.prior import START
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import supported, with_possible_centre, with_uncertain_centre
from ospc.pooling.summary import PARAMETERS, RESPONSE, VIGNETTE, Summary
from ospc.settings.pooling import MAX_SOLUTION_ROUNDS, SOLUTION_TOLERANCE
from ospc.settings.vignette import VIGNETTE_REACH
from ospc.system.library_threads import one_blas_thread

_SIMPLER = (VignetteBasis(VIGNETTE.radial, free_centre=True), VignetteBasis(VIGNETTE.radial))


@dataclass(frozen=True)
class Information:
    """The sum of summaries: A and b of their joint likelihood, and the errors that more samples do not reduce.

    The matrix A and ``systematic``, the sum of A S A, have shape (p, p), the vector b (p,). The errors of different
    recordings are independent. ``points`` and ``groups`` count the scene points and their groups. The usable radius
    and the reach determine the knots of the vignette, and the measured radius is that of the last observations.
    """

    matrix: FloatArray
    vector: FloatArray
    systematic: FloatArray
    points: int = 0
    groups: int = 0
    usable_radius: float = 1.0
    measured_radius: float = 1.0
    vignette_reach: float = VIGNETTE_REACH

    @classmethod
    def of(cls, summaries: Sequence[Summary], usable_radius: float | None = None) -> Information:
        """Return the sum over summaries; their order only affects the last bits.

        By default, the usable radius is the largest of the summaries, as the reach of the knots always is.
        """
        nothing = np.zeros((PARAMETERS, PARAMETERS))
        moving = [s for s in summaries if not s.stationary]
        if usable_radius is None:
            usable_radius = max((s.usable_radius for s in moving), default=1.0)
        vignette_reach = max((s.vignette_reach for s in moving), default=VIGNETTE_REACH)
        summaries = [s.with_knots(usable_radius, vignette_reach) for s in summaries]
        return cls(
            np.sum([nothing, *(s.matrix for s in summaries)], axis=0),
            np.sum([nothing[0], *(s.vector for s in summaries)], axis=0),
            np.sum([nothing, *(s.systematic_matrix for s in summaries)], axis=0),
            sum(s.points for s in summaries),
            sum(s.groups for s in summaries),
            usable_radius,
            max((s.measured_radius for s in moving), default=1.0),
            vignette_reach,
        )

    def without(self, summary: Summary) -> Information:
        """Return the information without one of the summaries."""
        summary = summary.with_knots(self.usable_radius, self.vignette_reach)
        matrix, vector = self.matrix - summary.matrix, self.vector - summary.vector
        systematic = self.systematic - summary.systematic_matrix
        points, groups = self.points - summary.points, self.groups - summary.groups
        return replace(self, matrix=matrix, vector=vector, systematic=systematic, points=points, groups=groups)


def solve(information: Information, vignette: VignetteBasis = VIGNETTE, start: Fit | None = None) -> Fit:
    """Return the maximum a posteriori parameters.

    ``vignette`` is the common model, or one without its last parameters. ``start`` is a solution for nearly the same
    information and the same model; reusing its prior saves most of the time.
    """
    with one_blas_thread():
        vignette = replace(vignette, usable_radius=information.usable_radius, reach=information.vignette_reach)
        model = Model(RESPONSE, vignette, Effects())
        parameters = model.typical if start is None else start.parameters
        p = len(parameters)
        equations = NormalEquations(information.matrix[:p, :p], information.vector[:p], np.zeros((p, p)))
        # The prior is on ln γ, linearised at the result of the previous round.
        hyperparameters = START if start is None else start.hyperparameters
        for _ in range(MAX_SOLUTION_ROUNDS):
            prior = model.prior(parameters)
            if start is None:
                hyperparameters = equations.maximize_evidence(prior, hyperparameters)
            found = model.limited(equations.solve(prior, hyperparameters, model.floor), parameters)
            change, parameters = found - parameters, found
            precision = equations.posterior_precision(prior, hyperparameters)
            if float(change @ precision @ change) < SOLUTION_TOLERANCE:
                break
        chance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        return Fit(
            RESPONSE,
            vignette,
            Effects(),
            parameters,
            covariance=chance + chance @ information.systematic[:p, :p] @ chance,
            chance=chance,
            errors=ErrorModel(),
            hyperparameters=hyperparameters,
            points=information.points,
            groups=information.groups,
            measured_radius=information.measured_radius,
        )


def solve_with_chosen_vignette(information: Information) -> Fit:
    """Return the maximum a posteriori parameters with a vignette no richer than the information supports."""
    fit = solve(information)
    for simpler in _SIMPLER:
        if supported(fit, len(fit.vignette_basis) - len(simpler)):
            break
        wider, fit = fit, solve(information, simpler)
    if fit.vignette_basis.free_centre:
        return with_uncertain_centre(fit)
    return with_possible_centre(fit, wider.parameters, wider.chance)
