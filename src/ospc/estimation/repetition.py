"""The same curve estimated again and again, and averaged (paper, section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray


@dataclass
class Estimates:
    """Repeated estimates of one curve, one a window, and why others were not accepted.

    Attributes
    ----------
    accepted
        Coefficients of the accepted estimates.
    rejected
        Windows whose estimate did not predict the exposure ratios, or was no response at all.
    impossible
        Windows whose estimate was a vignette that is not positive everywhere.
    poor
        Windows with too few samples to estimate anything.
    """

    accepted: list[FloatArray] = field(default_factory=list)
    rejected: int = 0
    impossible: int = 0
    poor: int = 0

    @property
    def mean(self) -> FloatArray:
        """Average of the accepted estimates (paper, section 4.1)."""
        return np.asarray(np.mean(self.accepted, axis=0))

    def spread_of_curve(self, curves: FloatArray) -> FloatArray | None:
        """Return the standard error of the average of curves, shape (estimates, n) -> (n,); None for a single one."""
        if len(curves) < 2:
            return None
        return np.asarray(np.std(curves, axis=0, ddof=1) / np.sqrt(len(curves)))
