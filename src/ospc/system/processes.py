"""Work in other processes of this machine; if a process dies, only its task is lost."""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from time import monotonic
from typing import Any, Generic, TypeVar

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")

_PATIENCE_S = 5
"""Time that idle or terminated processes have to exit before they are killed."""


def in_processes(
    function: Callable[[_Task], _Result],
    tasks: Iterable[_Task],
    count: int,
    lost: Callable[[_Task, str], _Result],
) -> Generator[tuple[_Task, _Result], None, None]:
    """Yield every task with the result of a function, as they finish, from at most ``count`` processes.

    Function, tasks and results are pickled. An exception of the function is raised here. ``lost`` is called with a
    task whose process died, and the reason, and returns the result or raises an error. Ending the iteration early
    ends all processes; in those that are busy, SystemExit is raised.
    """
    waiting, idle, busy = iter(tasks), list[Worker[_Task]](), list[Worker[_Task]]()
    try:
        while True:
            while len(busy) < count and (task := next(waiting, None)) is not None:
                busy.append(idle.pop() if idle else Worker(function))
                busy[-1].give(task)
            if not busy:
                return
            ready = wait([worker.connection for worker in busy])
            for worker in [each for each in busy if each.connection in ready]:
                try:
                    result = worker.connection.recv()
                except (EOFError, OSError):
                    result = lost(worker.task, f"the process that worked on it died ({worker.death()})")
                busy.remove(worker)
                if worker.process.is_alive():
                    idle.append(worker)
                if isinstance(result, Exception):
                    raise result
                yield worker.task, result
    finally:
        end(idle, interrupt=busy)


class Worker(Generic[_Task]):
    """A process that works on one task after the other; ``connection`` receives the result of each, or its error."""

    task: _Task

    def __init__(self, function: Callable[[_Task], Any]) -> None:
        # A fresh interpreter, because libraries with threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self.connection, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(function, there), daemon=True)
        with _without_interruption():
            self.process.start()
        there.close()

    def give(self, task: _Task) -> None:
        """Send a task."""
        self.task = task
        with suppress(OSError):  # if the process has died, waiting for its result shows that
            self.connection.send(task)

    def death(self) -> str:
        """Return why the process died."""
        self.process.join()
        code = self.process.exitcode or 0
        if code >= 0:
            return f"exit code {code}"
        with suppress(ValueError):
            name = signal.Signals(-code).name
            return f"{name}, perhaps out of memory" if name == "SIGKILL" else name
        return f"signal {-code}"


def end(idle: Sequence[Worker[_Task]], interrupt: Sequence[Worker[_Task]] = ()) -> None:
    """End the processes of idle workers, and of others whose tasks are interrupted, all at the same time."""
    for worker in interrupt:
        worker.process.terminate()
    for worker in (*idle, *interrupt):
        worker.connection.close()
    deadline_s = monotonic() + _PATIENCE_S
    for worker in (*idle, *interrupt):
        worker.process.join(max(0, deadline_s - monotonic()))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


@contextmanager
def _without_interruption() -> Iterator[None]:
    """Block Ctrl-C, also in processes started within: they would end with a traceback until they ignore it."""
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # otherwise starting a process does this, and unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(function: Callable[[Any], Any], connection: Connection) -> None:
    """Work on tasks until there are no more."""
    # Ctrl-C reaches all processes of a terminal, but only the parent process handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Exiting by an exception lets a task remove its files and end a program that it started.
    signal.signal(signal.SIGTERM, lambda _signal, _frame: sys.exit(1))
    with suppress(EOFError, OSError):
        while True:
            task = connection.recv()
            try:
                result = function(task)
            except Exception as error:  # raised again where the result is wanted
                result = error
            connection.send(result)
