"""All drawings of a calibration, and a separate process that draws them.

Matplotlib holds the interpreter lock while it is loaded and while it draws, and would delay all other threads.
"""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import cache, partial
from typing import NamedTuple, ParamSpec, TypeAlias, TypeVar

from ospc.report.charts import Findings, charts_as_svg
from ospc.report.pictures import pictures_as_png
from ospc.report.style import load

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

_PROGRAM = (
    "import gc, sys; gc.set_threshold{threshold}; sys.path[:] = {path}; "
    "from ospc.report.drawing import serve; serve()"
)


class Drawings(NamedTuple):
    """The charts of a report as :func:`charts_as_svg` returns them, and the content of PNG files by name."""

    charts: dict[str, str]
    pictures: dict[str, bytes]


Drawn: TypeAlias = Callable[[], Future[Drawings]]
"""Starts drawing on its first call, and returns the future."""


def drawings_of(findings: Findings) -> Drawings:
    """Draw all charts and pictures."""
    return Drawings(charts_as_svg(findings), pictures_as_png(findings))


class DrawingProcess:
    """Runs functions one after the other in a second process, which ends with this one.

    If a function fails there or cannot be sent, or if no process can be started, it runs in this process instead.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "ospc-drawing")
        self._process = _started()

    def submit(
        self, function: Callable[_Arguments, _Result], *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Future[_Result]:
        """Call a module-level function in the process."""
        return self._thread.submit(self._result, partial(function, *args, **kwargs))

    def _result(self, work: Callable[[], _Result]) -> _Result:
        try:
            assert self._process is not None
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            pickle.dump(work, self._process.stdin)
            self._process.stdin.flush()
            result: _Result = pickle.load(self._process.stdout)  # noqa: S301 - from a process of this program
        except Exception:
            return work()
        return result


@cache
def drawing_process() -> DrawingProcess:
    """Return the shared drawing process, started on the first call."""
    return DrawingProcess()


def _started() -> subprocess.Popen[bytes] | None:
    """Start a process that serves; return None if it cannot be started."""
    if getattr(sys, "frozen", False):  # the executable is this program, not an interpreter
        return None
    try:
        process = subprocess.Popen(  # noqa: S603 - this program
            [sys.executable, "-c", _PROGRAM.format(path=sys.path, threshold=gc.get_threshold())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            # Only this process handles Ctrl-C in the terminal.
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
    except (OSError, ValueError):
        return None
    atexit.register(_end, process)
    return process


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()  # so that its processor time is counted as that of a child


def serve() -> None:
    """Run functions sent to standard input, until its end or a failure, and send results to standard output."""
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # keep other output out of the results
    load()
    gc.freeze()  # imported objects are never collected
    with suppress(Exception):
        while True:
            pickle.dump(pickle.load(sys.stdin.buffer)(), results)  # noqa: S301 - from a process of this program
            results.flush()
