"""A second thread for independent steps."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class SecondThread:
    """Runs functions one after another in its own thread; useful if they release the interpreter lock."""

    def __init__(self) -> None:
        self._process = 0
        self._executor: ThreadPoolExecutor | None = None

    def submit(
        self, function: Callable[_Arguments, _Result], *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Future[_Result]:
        """Call a function in the thread."""
        # A fork copies the executor but not its thread, so submitted work would wait forever.
        if self._executor is None or self._process != os.getpid():
            self._process, self._executor = os.getpid(), ThreadPoolExecutor(1, "ospc-second")
        return self._executor.submit(function, *args, **kwargs)

    def end(self) -> None:
        """Wait until the submitted work is done, and end the thread; the next work starts it again."""
        if self._executor is not None and self._process == os.getpid():
            self._executor.shutdown()
        self._executor = None
