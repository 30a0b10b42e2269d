"""What a recording says about an effect beside response and vignette, such as veiling glare."""

from __future__ import annotations

from dataclasses import dataclass

LATE_EXPOSURES = "late exposures"
"""Name of the effect of exposures that are a part of a frame late."""


@dataclass(frozen=True)
class EffectEstimate:
    """The estimate of one effect.

    Attributes
    ----------
    name
        What it is called.
    value, sigma
        Its size and the standard deviation of that, in the unit that :doc:`/theory/effects` gives.
    corrected
        Whether response and vignette are those without it. Otherwise it cannot be distinguished from zero, and its
        standard deviation is part of theirs.
    contradicts
        Whether it is something that no camera with one response and one vignette does.
    """

    name: str
    value: float
    sigma: float
    corrected: bool = False
    contradicts: bool = False
