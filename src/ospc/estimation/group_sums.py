"""Sums over the points of each pair of frames: normal equations with and without the pairs' means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.normal_equations import NormalEquations
from ospc.settings.fit import GROUPS_PER_BLOCK, MIN_BLOCKS


@dataclass(frozen=True)
class GroupSums:
    """The normal equations, and sums over the points of each group of observations, with weights w and rows r."""

    about: FloatArray
    """Parameters at which misfits are taken, shape (p,)."""
    matrix: FloatArray
    """AᵀWA, shape (p, p)."""
    vector: FloatArray
    """AᵀWb, shape (p,)."""
    scores: FloatArray
    """Sums of w r times the misfit, shape (groups, p)."""
    rows: FloatArray
    """Sums of w r, shape (groups, p)."""
    precision: FloatArray
    """Sums of w, shape (groups,)."""
    misfit: FloatArray
    """Sums of w times the misfit, shape (groups,)."""

    def mean_misfit(self, parameters: FloatArray) -> FloatArray:
        """Return the mean misfit of each group at parameters of shape (p,)."""
        return np.asarray((self.misfit - self.rows @ (parameters - self.about)) / self._divisor)

    @property
    def by_chance(self) -> FloatArray:
        """Variance of each mean due to chance, shape (groups,); huge for a group without points."""
        return 1 / self._divisor

    @property
    def _divisor(self) -> FloatArray:
        """The precision, not zero for a group without points, and such that products of its reciprocal are finite."""
        return np.maximum(self.precision, 1e-100)

    @cached_property
    def within(self) -> GroupSums:
        """The sums within groups, without the groups' means."""
        root = np.sqrt(self.precision)[:, None]
        return self.plus(self.means(lambda values: values * root, self.about), sign=-1)

    def means(self, whiten: Callable[[FloatArray], FloatArray], about: FloatArray) -> GroupSums:
        """Return the sums of the groups' means alone, with misfits at parameters of shape (p,).

        ``whiten`` decorrelates the means, (groups, p + 1) -> (groups, p + 1).
        """
        whitened = whiten(np.column_stack([self.mean_rows, self.mean_misfit(about)]))
        row, misfit = whitened[:, :-1], whitened[:, -1]
        matrix, vector, scores = row.T @ row, row.T @ (misfit + row @ about), row * misfit[:, None]
        return replace(self, about=about, matrix=matrix, vector=vector, scores=scores)

    @cached_property
    def mean_rows(self) -> FloatArray:
        """The mean row of each group, shape (groups, p)."""
        return np.asarray(self.rows / self._divisor[:, None])

    def plus(self, other: GroupSums, sign: int = 1) -> GroupSums:
        """Return the sum or difference of these sums and others of the same groups."""
        return replace(
            self,
            matrix=self.matrix + sign * other.matrix,
            vector=self.vector + sign * other.vector,
            scores=self.scores + sign * other.scores,
        )

    def equations(self) -> NormalEquations:
        """Return the equations with the scatter of the scores between blocks of groups.

        Errors of a pair of frames recur in the next pairs, which show the same scene. Consecutive groups therefore
        form a block, as long as enough blocks remain to measure the scatter between them.
        """
        size = int(np.clip(len(self.scores) // MIN_BLOCKS, 1, GROUPS_PER_BLOCK))
        by_block = np.add.reduceat(self.scores, np.arange(0, len(self.scores), size))
        return NormalEquations(self.matrix, self.vector, by_block.T @ by_block, blocks=len(by_block))
