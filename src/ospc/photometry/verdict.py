"""How well one quantity of a camera is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["identifiable", "marginal", "not identifiable"]


@dataclass(frozen=True)
class Verdict:
    """How well one quantity is known.

    Attributes
    ----------
    state
        Whether the recording determines the quantity.
    reason
        Why, in one sentence with the figures behind it.
    remedy
        What to record instead or in addition; empty where nothing is missing.
    """

    state: State
    reason: str
    remedy: str = ""

    @property
    def known(self) -> bool:
        """Whether the quantity is estimated at all."""
        return self.state != "not identifiable"
