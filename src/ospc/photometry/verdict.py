"""A verdict: how well a recording determines one quantity of a camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["identifiable", "marginal", "not identifiable"]


@dataclass(frozen=True)
class Verdict:
    """How well a recording determines one quantity.

    Attributes
    ----------
    state
        Whether the recording determines the quantity.
    reason
        Why, in one sentence with the numbers behind it.
    remedy
        What to record instead or in addition; empty if nothing is missing.
    """

    state: State
    reason: str
    remedy: str = ""

    @property
    def known(self) -> bool:
        """Whether the quantity is estimated at all."""
        return self.state != "not identifiable"
