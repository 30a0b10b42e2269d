"""All drawings of a calibration, and a separate process that draws them.

Matplotlib holds the interpreter lock while it is loaded and while it draws, and would delay all other threads.
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
from typing import Any, NamedTuple, ParamSpec, TypeAlias, TypeVar

from ospc.processes import Worker
from ospc.report.charts import ReportFindings, charts_as_svg
from ospc.report.pictures import picture_as_png
from ospc.report.style import load
from ospc.second_thread import SecondThread

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class Drawings(NamedTuple):
    """The charts of a report as :func:`charts_as_svg` returns them, and the picture as PNG data."""

    charts: dict[str, str]
    picture: bytes


Drawn: TypeAlias = Callable[[], Future[Drawings]]
"""Starts drawing on its first call, and returns the future."""


def drawings_of(findings: ReportFindings) -> Drawings:
    """Draw all charts and the picture."""
    return Drawings(charts_as_svg(findings), picture_as_png(findings))


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
    load()
    gc.freeze()  # imported objects are never collected
