"""When to do again what costs time beside the work itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Pace:
    """Says when to look again: not before ``least_s``, and so that looking takes at most a ``share`` of the time."""

    def __init__(self, least_s: float, share: float) -> None:
        self._least_s, self._share = least_s, share
        self._next_s = -float("inf")

    @property
    def due(self) -> bool:
        """Whether it is time."""
        return self.remaining_s == 0

    @property
    def remaining_s(self) -> float:
        """How long it is until it is time."""
        return max(0.0, self._next_s - time.monotonic())

    @contextmanager
    def look(self) -> Iterator[None]:
        """Measure how long a look takes."""
        begun_s = time.monotonic()
        yield
        now_s = time.monotonic()
        self._next_s = now_s + max(self._least_s, (now_s - begun_s) / self._share)
