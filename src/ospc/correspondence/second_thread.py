"""One more thread, for work that releases the interpreter lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class SecondThread:
    """Runs functions one after the other in a thread of its own; a forked process starts its own."""

    def __init__(self) -> None:
        self._process = 0
        self._executor: ThreadPoolExecutor | None = None

    def submit(
        self, function: Callable[Arguments, Result], *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        """Call a function in the thread."""
        # A fork copies the executor but not its thread: work given to it would wait for ever.
        if self._executor is None or self._process != os.getpid():
            self._process, self._executor = os.getpid(), ThreadPoolExecutor(1, "ospc-second")
        return self._executor.submit(function, *args, **kwargs)
