"""Ctrl-C and SIGTERM as a request to finish early and keep the results so far."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells expect it: 128 + SIGINT."""

_Mode = Literal["at once", "deferred", "held"]

_SAME_S = 2.0
"""Signals within this time, in seconds, count as one request: keys repeat, and the first may be noticed late."""


class Interruption:
    """Handles SIGINT and SIGTERM as a context manager.

    By default, a signal raises ``KeyboardInterrupt`` at once. Within :meth:`deferred`, the first only sets
    :attr:`requested`, so that no step of the work is interrupted; a second one, some seconds later, raises. Within
    :meth:`held`, none raises.
    """

    def __init__(self) -> None:
        self.count = 0
        """Number of signals so far."""
        self._counted_s = -float("inf")
        self._mode: _Mode = "at once"
        self._before: dict[int, Any] = {}

    @property
    def requested(self) -> bool:
        """Whether there was a signal."""
        return self.count > 0

    def check(self) -> None:
        """Raise ``KeyboardInterrupt`` if there was a signal."""
        if self.requested:
            raise KeyboardInterrupt

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """Defer the first signal until the caller asks for :attr:`requested`."""
        with self._switched("deferred"):
            yield

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold back all signals, while files are written."""
        with self._switched("held"):
            yield

    def __enter__(self) -> Interruption:
        # Only the main thread can handle signals; in others, the handlers stay as they are.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _handle(self, *_signal: object) -> None:
        now_s = time.monotonic()
        if now_s - self._counted_s < _SAME_S and self._mode != "at once":
            return
        self._counted_s = now_s
        self.count += 1
        if self._mode == "at once" or (self._mode == "deferred" and self.count > 1):
            raise KeyboardInterrupt

    @contextmanager
    def _switched(self, mode: _Mode) -> Iterator[None]:
        before, self._mode = self._mode, mode
        try:
            yield
        finally:
            self._mode = before


@contextmanager
def leaving(state: str) -> Iterator[None]:
    """Say what state an interruption of the work within leaves things in."""
    try:
        yield
    except KeyboardInterrupt as interruption:
        raise KeyboardInterrupt(state, *interruption.args) from None
