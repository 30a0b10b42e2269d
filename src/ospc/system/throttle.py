"""A limit on how often, and for how much of the time, a secondary task runs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Throttle:
    """Limits a repeated task: runs are at least ``least_s`` apart and take at most a ``share`` of the time."""

    def __init__(self, least_s: float, share: float) -> None:
        self._least_s, self._share = least_s, share
        self._next_s = -float("inf")

    @property
    def due(self) -> bool:
        """Whether the task may run now."""
        return self.remaining_s == 0

    @property
    def remaining_s(self) -> float:
        """Time until the task may run."""
        return max(0.0, self._next_s - time.monotonic())

    @contextmanager
    def timed(self) -> Iterator[None]:
        """Measure how long the task in this context takes."""
        begun_s = time.monotonic()
        yield
        now_s = time.monotonic()
        self._next_s = now_s + max(self._least_s, (now_s - begun_s) / self._share)
