"""What a recording says of a camera: how well each quantity is determined, and effects such as veiling glare."""

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
    """What to record instead or in addition; empty if nothing is missing."""

    @property
    def known(self) -> bool:
        """Whether the quantity is estimated at all."""
        return self.state != "not identifiable"


LATE_EXPOSURES = "late exposures"
"""Name of the effect of exposures that are a part of a frame late."""


@dataclass(frozen=True)
class EffectEstimate:
    """The estimate of one effect."""

    name: str
    value: float
    """Its size, in the unit that :doc:`/theory/effects` gives."""
    sigma: float
    """Standard deviation of its size."""
    corrected: bool = False
    """Whether response and vignette are those without it. Otherwise it cannot be distinguished from zero, and its
    standard deviation is part of theirs."""
    contradicts: bool = False
    """Whether it is something that no camera with one response and one vignette does."""
