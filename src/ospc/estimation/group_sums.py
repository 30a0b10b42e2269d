"""Sums over the points of each pair of frames: the normal equations, with and without the means of pairs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.pair_gains import PairGains
from ospc.settings.estimation import GROUPS_PER_BLOCK, MIN_BLOCKS


@dataclass(frozen=True)
class GroupSums:
    """The normal equations, and sums over the points of each group of observations, with weights w and rows r.

    Attributes
    ----------
    about, matrix, vector
        Parameters at which misfits are taken, AᵀWA and AᵀWb, shapes (p,), (p, p) and (p,).
    scores, rows
        Sums of w r times the misfit, and of w r, shape (groups, p).
    precision, misfit
        Sums of w, and of w times the misfit, shape (groups,).
    """

    about: FloatArray
    matrix: FloatArray
    vector: FloatArray
    scores: FloatArray
    rows: FloatArray
    precision: FloatArray
    misfit: FloatArray

    def gains(self, sigma: float, parameters: FloatArray) -> PairGains:
        """Return what the groups say of their gains, whose scale is known, with parameters of shape (p,)."""
        misfit = self.misfit - self.rows @ (parameters - self.about)
        return PairGains(self.precision, misfit / np.maximum(self.precision, 1e-300), sigma)

    def discounted(self, weight: FloatArray) -> GroupSums:
        """Return the sums with as much less weight of the means of groups, shape (groups,)."""
        precision = np.maximum(self.precision, 1e-300)
        row, mean = self.rows / precision[:, None], self.misfit / precision
        weighted = row * weight[:, None]
        return replace(
            self,
            matrix=self.matrix - row.T @ weighted,
            vector=self.vector - weighted.T @ (mean + row @ self.about),
            scores=self.scores - weighted * mean[:, None],
        )

    def discount_of_means(self, gains: PairGains, scale: float) -> tuple[FloatArray, FloatArray]:
        """Return what to subtract from the rows and misfits of each group, shapes (groups, p − 1) and (groups,).

        What is left, with the weights w, is equivalent to :meth:`discounted` (Fuller and Battese 1973).
        """
        share = 1 - np.sqrt(gains.precision_of_means(scale) * gains.by_chance)
        row = self.rows[:, :-1] / np.maximum(self.precision, 1e-300)[:, None]
        return share[:, None] * row, share * gains.mean

    def equations(self) -> NormalEquations:
        """Return the equations with the scatter of the scores between blocks of groups.

        Errors of one pair of frames recur in the next ones, which show the same scene. Consecutive groups form a
        block, as long as enough blocks remain to measure a spread between them.
        """
        size = int(np.clip(len(self.scores) // MIN_BLOCKS, 1, GROUPS_PER_BLOCK))
        by_block = np.add.reduceat(self.scores, np.arange(0, len(self.scores), size))
        return NormalEquations(self.matrix, self.vector, by_block.T @ by_block, blocks=len(by_block))
