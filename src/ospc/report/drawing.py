"""Everything that is drawn of a calibration, and a process of its own that draws it.

Matplotlib holds the interpreter while it is loaded and while it draws: in a thread it would delay all others.
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
"""Begins to draw when it is first called, and returns what can be waited for."""


def drawings_of(findings: Findings) -> Drawings:
    """Draw everything."""
    return Drawings(charts_as_svg(findings), pictures_as_png(findings))


class DrawingProcess:
    """Runs functions in an interpreter of its own, one after the other; it ends with this process.

    What fails there, or cannot be sent, is done here instead. So it is where no process can be started.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "ospc-drawing")
        self._process = _started()

    def submit(
        self, function: Callable[_Arguments, _Result], *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Future[_Result]:
        """Call a function of a module in the process."""
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
    """Return the one process that draws; it is started when this is first called."""
    return DrawingProcess()


def _started() -> subprocess.Popen[bytes] | None:
    """Return a new process that serves; None where none can be started."""
    if getattr(sys, "frozen", False):  # the executable is no interpreter but this very program
        return None
    try:
        process = subprocess.Popen(  # noqa: S603 - this program
            [sys.executable, "-c", _PROGRAM.format(path=sys.path, threshold=gc.get_threshold())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            # Ctrl-C in the terminal is for this process alone.
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
    except (OSError, ValueError):
        return None
    atexit.register(_end, process)
    return process


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()  # so that its processor time counts as that of this one's children


def serve() -> None:
    """Run what is sent to the standard input, until its end or a failure, and send results to the standard output."""
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # nothing else may be written among the results
    load()
    gc.freeze()  # what was imported stays
    with suppress(Exception):
        while True:
            pickle.dump(pickle.load(sys.stdin.buffer)(), results)  # noqa: S301 - from a process of this program
            results.flush()
