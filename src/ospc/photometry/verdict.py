"""A verdict: how well a recording determines one quantity of a camera."""

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
