"""Ctrl-C, SIGTERM and a closed terminal as a request to finish early and keep the results so far."""

from __future__ import annotations

import os
import signal
import stat
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Literal, TypeVar

_Mode = Literal["at once", "deferred", "held"]

_SAME_S = 2.0
"""Signals within this many seconds count as one request: keys repeat, and the first may be handled late."""

_HANG_UP = getattr(signal, "SIGHUP", None)
"""Sent when the terminal is closed; None on systems without it."""

_Item = TypeVar("_Item")


class Interruption:
    """Handles SIGINT, SIGTERM and SIGHUP as a context manager.

    By default, a signal raises ``KeyboardInterrupt`` at once. Within :meth:`deferred`, the first signal only sets
    :attr:`requested`, so that no step of the work is interrupted, and a second one raises if it comes some seconds
    later. Within :meth:`held`, no signal raises.
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

    def deferred(self) -> AbstractContextManager[None]:
        """Defer the first signal until the caller checks :attr:`requested`."""
        return self._switched("deferred")

    def until_requested(self, items: Iterable[_Item]) -> Iterator[_Item]:
        """Yield items until there is a signal, which also ends the wait for the next item."""
        waiting = iter(items)
        while True:
            try:
                with self._switched("at once"):
                    self.check()
                    item = next(waiting)
            except (StopIteration, KeyboardInterrupt):
                return
            yield item

    def held(self) -> AbstractContextManager[None]:
        """Ignore signals except for counting them, while files are written."""
        return self._switched("held")

    def __enter__(self) -> Interruption:
        # Only the main thread can install signal handlers.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._handle)
            if _HANG_UP is not None and signal.getsignal(_HANG_UP) is not signal.SIG_IGN:  # nohup ignores it
                self._before[_HANG_UP] = signal.signal(_HANG_UP, self._handle)
        return self

    def __exit__(self, *_error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _handle(self, number: int, _frame: object) -> None:
        if number == _HANG_UP:
            _write_nothing_to_lost_terminals()
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


def _write_nothing_to_lost_terminals() -> None:
    """Discard output to a closed terminal: an error in writing to it must not prevent saving."""
    for stream in (1, 2):
        if stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream):
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, stream)
            os.close(nothing)


@contextmanager
def leaving(state: str) -> Iterator[None]:
    """Attach to an interruption of the work within a message about the state of its output."""
    try:
        yield
    except KeyboardInterrupt as interruption:
        raise KeyboardInterrupt(state, *interruption.args) from None
