"""A separate process that draws.

Matplotlib holds the interpreter lock while it is loaded and while it draws, and would delay all other threads. This
module itself loads quickly, so that the process can be started before anything else.
"""

from __future__ import annotations

import gc
import operator
import os
import sys
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import cache, partial
from typing import Any, ParamSpec, TypeVar

from ospc.system.processes import Worker
from ospc.system.second_thread import SecondThread

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class DrawingProcess(SecondThread):
    """A thread that has its work done by a second process, which ends with this one.

    If a function fails there or cannot be sent, or if no process can be started, it runs in the thread instead.
    """

    def __init__(self) -> None:
        super().__init__()
        self._worker: Worker[Callable[[], Any]] | None = None
        if not getattr(sys, "frozen", False):  # otherwise the executable is this program, not an interpreter
            with suppress(OSError, ValueError, AssertionError):  # the last within a worker process
                self._worker = Worker(operator.call)
        self.submit(_prepare, gc.get_threshold(), os.getpid())

    def submit(
        self, function: Callable[_Arguments, _Result], *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Future[_Result]:
        """Call a module-level function in the process."""
        return super().submit(self._result, partial(function, *args, **kwargs))

    def _result(self, work: Callable[[], _Result]) -> _Result:
        try:
            assert self._worker is not None
            self._worker.give(work)
            result = self._worker.connection.recv()
        except Exception:
            return work()
        return work() if isinstance(result, Exception) else result


@cache
def drawing_process() -> DrawingProcess:
    """Return the shared drawing process, started on the first call."""
    return DrawingProcess()


def _prepare(threshold: tuple[int, int, int], parent: int) -> None:
    """Load what drawing needs, without output; do nothing in the process that asked for it."""
    if os.getpid() == parent:
        return
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    gc.set_threshold(*threshold)
    import ospc.report.pictures  # noqa: F401
    from ospc.report.style import load

    load()
    gc.freeze()  # imported objects are never collected
