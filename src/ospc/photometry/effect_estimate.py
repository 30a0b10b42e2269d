"""What a recording says about an effect beside response and vignette, such as veiling glare."""

from __future__ import annotations

from dataclasses import dataclass

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
