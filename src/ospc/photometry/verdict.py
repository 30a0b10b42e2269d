"""Verdicts on how well a recording determines each quantity, and estimates of effects such as veiling glare."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["identifiable", "marginal", "not identifiable"]


@dataclass(frozen=True)
class Verdict:
    """How well a recording determines one quantity."""

    state: State
    """Whether the recording determines it."""
    reason: str
    """Why, in one sentence with the numbers behind it."""
    remedy: str = ""
    """What to record instead or in addition; empty if not needed."""

    @property
    def known(self) -> bool:
        """Whether the quantity is estimated."""
        return self.state != "not identifiable"


LATE_EXPOSURES = "late exposures"
"""Name of the effect of exposures that lag by a fraction of a frame."""
NOMINAL_EXPOSURES = "nominal exposures"
"""Name of the effect of nominal shutter speeds."""
INEXACT_EXPOSURES = "inexact exposures"
"""Name of the effect of exposures that are wrong by a random factor, which is the same whenever they recur."""


@dataclass(frozen=True)
class EffectEstimate:
    """The estimate of one effect."""

    name: str
    value: float
    """Its size, in the unit given in :doc:`/theory/effects`."""
    sigma: float
    """Standard deviation of its size."""
    corrected: bool = False
    """Whether response and vignette are corrected for it. Otherwise it cannot be distinguished from zero, and its
    standard deviation is included in theirs."""
    contradicts: bool = False
    """Whether it contradicts the model of one response and one vignette."""
