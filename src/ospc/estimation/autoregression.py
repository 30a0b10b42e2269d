"""Autoregressive models of series that are correlated in time, by which their correlation is taken out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray
from ospc.settings.estimation import LONGEST_GAIN_MEMORY, VALUES_PER_GAIN_MEMORY


@dataclass(frozen=True)
class Autoregression:
    """Each value is a sum of the ones before it, times coefficients, and of something new.

    Attributes
    ----------
    coefficients
        Those of the value before, of the one before that, and so on, shape (order,).
    new_share
        Variance of what is new, over that of the values.
    """

    coefficients: FloatArray = field(default_factory=lambda: np.empty(0))
    new_share: float = 1.0

    @classmethod
    def of(cls, values: FloatArray) -> Autoregression:
        """Return the model of a series of mean zero, shape (n,), by the method of Burg (1975).

        Its order is the one with the least information criterion of Akaike (1974).
        """
        most = min(LONGEST_GAIN_MEMORY, len(values) // VALUES_PER_GAIN_MEMORY)
        found = best = UNCORRELATED
        least = 0.0
        forward = backward = values
        for order in range(1, most + 1):
            forward, backward = forward[1:], backward[:-1]
            power = float(forward @ forward + backward @ backward)
            reflected = 2 * float(forward @ backward) / power if power > 0 else 0.0
            coefficients = np.append(found.coefficients - reflected * found.coefficients[::-1], reflected)
            found = cls(coefficients, max(found.new_share * (1 - reflected**2), 1e-9))
            forward, backward = forward - reflected * backward, backward - reflected * forward
            criterion = len(values) * np.log(found.new_share) + 2 * order
            if criterion < least:
                least, best = criterion, found
        return best

    def whitened(self, values: FloatArray) -> FloatArray:
        """Return what is new in each value, with the variance of the values, shape (n, ...).

        The first values, which have too few before them, are kept.
        """
        order = len(self.coefficients)
        if not order:
            return values
        new = values[order:].copy()
        for lag, coefficient in enumerate(self.coefficients, 1):
            new -= coefficient * values[order - lag : -lag]
        return np.concatenate([values[:order], new / np.sqrt(self.new_share)])


UNCORRELATED = Autoregression()
"""The model of values that have nothing to do with each other."""
